"""The machine itself: Zenoh's port, disk, clock, priorities."""

from __future__ import annotations

import ctypes
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from service.config.sections import Configuration
from service.doctor.check import Check

LOW_DISK = 1e9
"""Bytes; a recording of a camera at 50 frames/s fills them in four minutes."""

NOT_BEFORE = 1_735_689_600
"""1 January 2025: a clock that shows less has lost its time."""

UNSYNCHRONISED = 5
"""TIME_ERROR of adjtimex(2)."""


ZENOH_REMEDY = (
    """echo '{ listen: { endpoints: ["tcp/127.0.0.1:7448"] } }' > zenoh.json5  """
    """(and in the configuration: [zenoh] config = "zenoh.json5")"""
)


def check_zenoh(configuration: Configuration) -> Iterator[Check]:
    """Is the service's endpoint free?"""
    from service.wire.addresses import DEFAULT_ENDPOINT
    from service.wire.sockets import holder

    file = configuration.zenoh.config
    if file is not None:
        there = file.is_file()
        yield Check(
            name="Zenoh",
            state="ok" if there else "problem",
            finding=f"{file}" if there else f"{file} is not there",
            remedy=None if there else "correct zenoh.config in the configuration",
        )
        return
    port = int(DEFAULT_ENDPOINT.rpartition(":")[2])
    user = (holder(port) or "another user's process") if _is_taken(port) else None
    if user is None:
        yield Check(name="Zenoh", state="ok", finding=f"{DEFAULT_ENDPOINT} is free")
    elif "lidarboost" in user or "python" in user:
        yield Check(name="Zenoh", state="ok", finding=f"{DEFAULT_ENDPOINT} is held by {user}: a service runs")
    else:
        yield Check(
            name="Zenoh",
            state="problem",
            finding=f"{DEFAULT_ENDPOINT} is in use by {user}",
            remedy=ZENOH_REMEDY,
        )


def check_disk(configuration: Configuration) -> Iterator[Check]:
    """Can recordings be written, and is there room?"""
    folder = configuration.recording.directory.absolute()
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not there.is_dir():
        yield Check(
            name="disk",
            state="problem",
            finding=f"{there} is no directory (for recording.directory {folder})",
            remedy="[recording] directory = another one  (in the configuration)",
        )
        return
    if not os.access(there, os.W_OK):
        yield Check(
            name="disk",
            state="problem",
            finding=f"{there} cannot be written by this user (for recording.directory {folder})",
            remedy=f'sudo install -d -o "$USER" {folder}',
        )
        return
    free, budget = shutil.disk_usage(there).free, configuration.recording.budget * 1e6
    said = f"{free / 1e9:.1f} GB free for {folder}, budget {budget / 1e9:.1f} GB"
    if free < LOW_DISK:
        yield Check(
            name="disk", state="problem", finding=said, remedy=f"free some: du -sh {there}/* | sort -h"
        )
    elif free < budget and not _holds_recordings(folder):
        megabytes = int(0.8 * free / 1e6)
        yield Check(
            name="disk",
            state="warning",
            finding=f"{said}: the disk fills before the oldest recording is deleted",
            remedy=f"[recording] budget = {megabytes}  (in the configuration)",
        )
    else:
        yield Check(name="disk", state="ok", finding=said)


def check_clock(_: Configuration) -> Iterator[Check]:
    """Does the clock show the time?"""
    remedy = "sudo timedatectl set-ntp true"
    if time.time() < NOT_BEFORE:
        shown = time.strftime("%Y-%m-%d", time.gmtime())
        yield Check(name="clock", state="problem", finding=f"the clock shows {shown}", remedy=remedy)
    elif _synchronised() is False:
        yield Check(
            name="clock",
            state="warning",
            finding="the clock is not synchronised: times of different machines will not agree",
            remedy=remedy,
        )
    else:
        yield Check(name="clock", state="ok", finding=time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime()))


def check_priority(_: Configuration) -> Iterator[Check]:
    """May the capture go before all else?"""
    from service.capture.priority import Foremost

    if sys.platform != "linux":
        return
    with Foremost() as foremost:
        permitted = foremost.is_permitted
    if permitted:
        yield Check(name="priority", state="ok", finding="the capture may go before all else")
    else:
        yield Check(
            name="priority",
            state="warning",
            finding="a capture begun here goes no sooner than other programs: frames may be lost",
            remedy="LimitNICE=-15 in the systemd unit, as deploy/lidarboost.service has it; or "
            'echo "$USER - nice -15" | sudo tee /etc/security/limits.d/lidarboost.conf, and log in again',
        )


def _is_taken(port: int) -> bool:
    """Whether somebody listens on a port of the loopback."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # what just ended does not count
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def _synchronised() -> bool | None:
    """Whether the kernel's clock is disciplined by NTP or PTP; None where it does not say."""
    try:
        query = ctypes.create_string_buffer(512)  # struct timex, zeroed: modes = 0 only reads
        state = ctypes.CDLL(None).adjtimex(query)
    except (OSError, AttributeError):
        return None
    return None if state < 0 else bool(state != UNSYNCHRONISED)


def _holds_recordings(folder: Path) -> bool:
    return folder.is_dir() and any(folder.glob("*.mcap"))
