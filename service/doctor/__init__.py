"""Checks of what a rig needs from its machine; for each problem, the line that mends it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from service.config.sections import Configuration
from service.doctor.check import Check
from service.doctor.cluster import check_cluster
from service.doctor.host import check_clock, check_disk, check_priority, check_zenoh
from service.doctor.kernels import check_kernels
from service.doctor.ros2 import check_ros2
from service.doctor.serial_ports import check_serial
from service.doctor.usb import check_udev, check_usb, check_vendor_library, udev_rules

__all__ = ["Check", "examine", "udev_rules"]

CHECKS: tuple[Callable[[Configuration], Iterator[Check]], ...] = (
    check_usb,
    check_udev,
    check_vendor_library,
    check_serial,
    check_zenoh,
    check_ros2,
    check_kernels,
    check_cluster,
    check_disk,
    check_clock,
    check_priority,
)


def examine(configuration: Configuration) -> list[Check]:
    """Look at everything; no device is opened, nothing sent or changed."""
    return [check for part in CHECKS for check in part(configuration)]
