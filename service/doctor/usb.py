"""Cameras on USB: libusb, permission, the udev rule, the vendor's library."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from service.config.sections import Configuration
from service.doctor.check import Check
from service.doctor.processes import read

RULE_FOLDERS = (Path("/etc/udev/rules.d"), Path("/run/udev/rules.d"), Path("/usr/lib/udev/rules.d"))
RULE_LIMIT = 73
"""73-seat-late.rules turns the tag `uaccess` into access; rules that set it must come before."""

RULE_REMEDY = (
    "lidarboost doctor --udev-rules | sudo tee /etc/udev/rules.d/60-lidarboost.rules && "
    "sudo udevadm control --reload && sudo udevadm trigger --subsystem-match=usb"
)

LIBRARY_REMEDY = (
    "sudo apt install ./libmesasr-dev-1.0.14-706.amd64.deb  (the vendor's package; only needed for "
    "camera.backend = 'mesasr')"
)


def udev_rules() -> str:
    """The rules for all known cameras, one line each."""
    from drivers.usb.profile import shipped_profiles

    ids = sorted({(known.vendor, known.product) for p in shipped_profiles() for known in p.ids})
    return "".join(
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", '
        'MODE="0660", GROUP="plugdev", TAG+="uaccess"\n'
        for vendor, product in ids
    )


def check_usb(configuration: Configuration) -> Iterator[Check]:
    """Is a camera plugged in, and may this user talk to it?"""
    from drivers.errors import NotAvailableError
    from drivers.listing import list_cameras

    try:
        cameras = list_cameras()
    except NotAvailableError as error:
        yield Check(name="USB", state="problem", finding=str(error), remedy="sudo apt install libusb-1.0-0")
        return
    if not cameras:
        wanted = configuration.camera.backend in ("usb", "mesasr")
        yield Check(
            name="USB",
            state="problem" if wanted else "warning",
            finding="no SwissRanger camera is plugged in",
            remedy="plug one in, power it, and see: lidarboost devices" if wanted else None,
        )
    for camera in cameras:
        denied = camera.permission == "denied"
        yield Check(
            name="USB",
            state="problem" if denied else "warning" if camera.remedy else "ok",
            finding=f"{camera.model} at {camera.where}, permission {camera.permission}",
            remedy=_permission_remedy() if denied else camera.remedy,
        )


def check_udev(_: Configuration) -> Iterator[Check]:
    """Is there a rule that udev still reads, early enough?"""
    if not any(folder.is_dir() for folder in RULE_FOLDERS):
        finding = "this machine has no udev; in a container, the rule belongs on the host"
        yield Check(name="udev rule", state="warning", finding=finding)
        return
    rules = _installed_rules()
    if rules.good:
        yield Check(name="udev rule", state="ok", finding=str(rules.good[0]))
    elif rules.late:
        early = rules.late[0].with_name("60-lidarboost.rules")
        yield Check(
            name="udev rule",
            state="problem",
            finding=f"{rules.late[0]} comes too late: its number must be below {RULE_LIMIT}",
            remedy=f"sudo mv {rules.late[0]} {early} && sudo udevadm control --reload",
        )
    else:
        old = f"; {rules.dead[0]} is in a syntax that udev no longer reads" if rules.dead else ""
        yield Check(
            name="udev rule",
            state="warning",
            finding=f"no rule lets people use a SwissRanger{old}",
            remedy=RULE_REMEDY,
        )


def check_vendor_library(configuration: Configuration) -> Iterator[Check]:
    """Is libmesasr there?"""
    from drivers.listing import vendor_library_problem

    problem = vendor_library_problem()
    if problem is None:
        yield Check(name="vendor library", state="ok", finding="found")
        return
    wanted = configuration.camera.backend == "mesasr"
    yield Check(
        name="vendor library",
        state="problem" if wanted else "warning",
        finding=problem,
        remedy=LIBRARY_REMEDY,
    )


class _Rules(NamedTuple):
    """Files with rules for SwissRangers: that work, that come too late, that udev no longer understands."""

    good: list[Path]
    late: list[Path]
    dead: list[Path]


def _installed_rules() -> _Rules:
    rules = _Rules([], [], [])
    for file in sorted(file for folder in RULE_FOLDERS for file in folder.glob("*.rules")):
        text = read(file)
        if not re.search(r"^[^#\n]*1ad2", text, re.MULTILINE):
            continue
        number = re.match(r"\d+", file.name)
        if "ATTR{idVendor}==" not in text:
            rules.dead.append(file)  # the vendor's own rule says SYSFS{}, which udev gave up in 2010
        elif "uaccess" in text and number and int(number[0]) >= RULE_LIMIT:
            rules.late.append(file)
        else:
            rules.good.append(file)
    return rules


def _permission_remedy() -> str:
    """The rule gives access to who sits at the machine, and to the group plugdev."""
    if _installed_rules().good:
        return f"sudo usermod -aG plugdev {os.environ.get('USER', '$USER')}  (then log in again)"
    return RULE_REMEDY
