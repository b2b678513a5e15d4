import json
import os
import pty
import re
import socket
import sys
from pathlib import Path

import pytest
from dask_cluster import dask_cluster
from typer.testing import CliRunner

from drivers.errors import NotAvailableError
from drivers.listing import FoundDevice
from service.cli import app
from service.config.sections import (
    CameraSection,
    Configuration,
    FusionSection,
    RecordingSection,
    StageSection,
    ZenohSection,
)
from service.doctor import host, serial_ports, udev_rules, usb
from service.doctor.cluster import check_cluster
from service.doctor.host import check_clock, check_disk, check_priority, check_zenoh
from service.doctor.kernels import check_kernels
from service.doctor.serial_ports import check_serial
from service.doctor.usb import check_udev, check_usb, check_vendor_library
from solver.runtime.survey import Survey

PLAIN = Configuration()


def only(checks):
    (found,) = checks
    return found


@pytest.fixture
def rules(tmp_path, monkeypatch):
    monkeypatch.setattr(usb, "RULE_FOLDERS", (tmp_path,))
    return tmp_path


def camera(permission, remedy=None):
    return FoundDevice(
        kind="camera", model="SR3000", serial=None, where="USB 1-2", backend="usb",
        permission=permission, remedy=remedy,
    )  # fmt: skip


def test_camera_without_permission_gets_the_rule_or_the_group(rules, monkeypatch):
    monkeypatch.setattr("drivers.listing.list_cameras", lambda: [camera("denied")])
    check = only(check_usb(PLAIN))
    assert check.state == "problem"
    assert check.remedy.startswith("lidarboost doctor --udev-rules | sudo tee /etc/udev/rules.d/60-lidar")
    (rules / "60-lidarboost.rules").write_text(udev_rules())
    assert only(check_usb(PLAIN)).remedy.startswith("sudo usermod -aG plugdev ")


def test_camera_that_can_be_used(monkeypatch):
    monkeypatch.setattr("drivers.listing.list_cameras", lambda: [camera("granted")])
    assert only(check_usb(PLAIN)).state == "ok"


def test_no_camera_is_a_problem_only_where_one_is_configured(monkeypatch):
    monkeypatch.setattr("drivers.listing.list_cameras", list)
    assert only(check_usb(PLAIN)).state == "warning"
    assert only(check_usb(Configuration(camera=CameraSection(backend="usb")))).state == "problem"


def test_libusb_that_is_missing(monkeypatch):
    def fail():
        raise NotAvailableError("libusb-1.0 cannot be loaded")

    monkeypatch.setattr("drivers.listing.list_cameras", fail)
    check = only(check_usb(PLAIN))
    assert (check.state, check.remedy) == ("problem", "sudo apt install libusb-1.0-0")


def test_rules_in_every_condition(rules):
    assert only(check_udev(PLAIN)).finding == "no rule lets people use a SwissRanger"
    vendor = rules / "46-mesa.rules"
    vendor.write_text('BUS!="usb_device", SYSFS{idVendor}=="1ad2", SYSFS{idProduct}=="0074", MODE="0666"\n')
    assert "a syntax that udev no longer reads" in only(check_udev(PLAIN)).finding
    late = rules / "99-lidarboost.rules"
    late.write_text(udev_rules())
    check = only(check_udev(PLAIN))
    assert check.state == "problem"
    assert check.remedy.startswith(f"sudo mv {late} {rules}/60-lidarboost.rules")
    late.rename(rules / "60-lidarboost.rules")
    assert only(check_udev(PLAIN)).state == "ok"


def test_printed_rules_are_those_in_the_repository():
    kept = (Path(__file__).parents[2] / "deploy" / "udev" / "60-lidarboost.rules").read_text()
    lines = [line for line in kept.splitlines() if line and not line.startswith("#")]
    assert sorted(lines) == sorted(udev_rules().splitlines())


def test_vendor_library_matters_where_it_is_configured(monkeypatch):
    monkeypatch.setattr("drivers.listing.vendor_library_problem", lambda: "libmesasr.so is not there")
    assert only(check_vendor_library(PLAIN)).state == "warning"
    check = only(check_vendor_library(Configuration(camera=CameraSection(backend="mesasr"))))
    assert check.state == "problem"
    assert "sudo apt install ./libmesasr" in check.remedy


def with_port(port):
    return Configuration(stage=StageSection(backend="ptu", options={"port": str(port)}))


def test_serial_port_in_every_condition(tmp_path, monkeypatch):
    monkeypatch.setattr(serial_ports, "is_running", lambda _: False)
    check = only(check_serial(with_port(tmp_path / "gone")))
    assert check.state == "problem"
    assert "/dev/serial/by-id" in check.remedy
    master, slave = pty.openpty()
    port = os.ttyname(slave)
    os.close(slave)
    assert only(check_serial(with_port(port))).state == "ok"
    monkeypatch.setattr(serial_ports, "user_of", lambda _: "process 7 (minicom)")
    assert "in use by process 7 (minicom)" in only(check_serial(with_port(port))).finding
    monkeypatch.setattr(os, "access", lambda *_: False)
    check = only(check_serial(with_port(port)))
    assert check.state == "problem"
    assert check.remedy.startswith("sudo usermod -aG ")
    os.close(master)


def test_modem_manager_is_warned_of(monkeypatch):
    monkeypatch.setattr(serial_ports, "is_running", lambda name: name == "ModemManager")
    *_, check = check_serial(with_port("/dev/null"))
    assert check.remedy == "sudo systemctl disable --now ModemManager"


def test_zenoh_port_in_use(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = server.getsockname()[1]
        monkeypatch.setattr("service.wire.addresses.DEFAULT_ENDPOINT", f"tcp/127.0.0.1:{taken}")
        monkeypatch.setattr("service.wire.sockets.holder", lambda _: "process 9 (zenohd)")
        assert only(check_zenoh(PLAIN)).state == "problem"
        monkeypatch.setattr("service.wire.sockets.holder", lambda _: "process 9 (lidarboost)")
        assert only(check_zenoh(PLAIN)).state == "ok"
        monkeypatch.setattr("service.wire.sockets.holder", lambda _: None)
        assert "another user's process" in only(check_zenoh(PLAIN)).finding
    check = only(check_zenoh(PLAIN))
    assert (check.state, check.finding) == ("ok", f"tcp/127.0.0.1:{taken} is free")
    missing = Configuration(zenoh=ZenohSection(config=Path("/no/such.json5")))
    assert only(check_zenoh(missing)).state == "problem"


def test_kernels_in_every_condition(tmp_path, monkeypatch):
    def found(**changes):
        known = {"folder": tmp_path, "compiled": 60, "kernels": 90, "fault": None} | changes
        monkeypatch.setattr("solver.runtime.survey.survey", lambda: Survey(**known))
        return only(check_kernels(PLAIN))

    check = found()
    said = f"60 of 90 kernels lie compiled in {tmp_path}"
    assert (check.state, check.finding) == ("ok", f"{said}; others are kept when they are compiled")
    check = found(compiled=0)
    assert check.state == "warning"
    assert "the first map takes minutes" in check.finding
    assert check.remedy.endswith(' -c "from solver.warming import warm_up; warm_up()"')
    check = found(fault="/x: Read-only file system")
    assert check.state == "warning"
    assert "(/x: Read-only file system)" in check.finding
    assert "NUMBA_CACHE_DIR" in check.remedy
    assert found(folder=None, kernels=0, compiled=0).state == "problem"


def test_kernels_are_counted_where_they_lie():
    (check,) = check_kernels(PLAIN)
    compiled, total = re.match(r"(\d+) of (\d+) kernels lie compiled in /", check.finding).groups()
    assert 0 <= int(compiled) <= int(total)
    assert int(total) > 50


def test_disk(tmp_path, monkeypatch):
    configuration = Configuration(recording=RecordingSection(directory=tmp_path / "new" / "folder"))

    class Usage:
        free = 30e9

    monkeypatch.setattr("shutil.disk_usage", lambda _: Usage)
    assert only(check_disk(configuration)).state == "ok"
    Usage.free = 10e9
    check = only(check_disk(configuration))
    assert check.state == "warning"
    assert check.remedy.startswith("[recording] budget = 8000")
    Usage.free = 0.5e9
    assert only(check_disk(configuration)).state == "problem"
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "install -d" in only(check_disk(configuration)).remedy


def test_a_file_is_no_directory_for_recordings(tmp_path):
    (tmp_path / "file").touch()
    for directory in (tmp_path / "file", tmp_path / "file" / "below"):
        check = only(check_disk(Configuration(recording=RecordingSection(directory=directory))))
        assert check.state == "problem"
        assert "is no directory" in check.finding


def test_clock(monkeypatch):
    monkeypatch.setattr(host, "_synchronised", lambda: True)
    assert only(check_clock(PLAIN)).state == "ok"
    monkeypatch.setattr(host, "_synchronised", lambda: False)
    assert only(check_clock(PLAIN)).state == "warning"
    monkeypatch.setattr("time.time", lambda: 0.0)
    check = only(check_clock(PLAIN))
    assert (check.state, check.remedy) == ("problem", "sudo timedatectl set-ntp true")


@pytest.mark.skipif(sys.platform != "linux", reason="threads have no priorities of their own")
def test_who_may_not_go_first_is_told_how_to_be_let(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr("os.setpriority", refuse)
    check = only(check_priority(PLAIN))
    assert (check.state, "LimitNICE=-15" in check.remedy) == ("warning", True)
    monkeypatch.setattr("os.setpriority", lambda *_: None)
    assert only(check_priority(PLAIN)).state == "ok"


def test_command_says_everything_and_ends_with_the_verdict(tmp_path, monkeypatch):
    monkeypatch.setattr("drivers.listing.list_cameras", list)
    monkeypatch.setattr(serial_ports, "is_running", lambda _: False)
    config = tmp_path / "rig.toml"
    config.write_text('[stage]\nbackend = "ptu"\noptions = { port = "/dev/no-such-port" }\n')
    done = CliRunner().invoke(app, ["doctor", "-c", str(config)])
    assert done.exit_code == 1
    for name in ("USB", "udev rule", "vendor library", "serial port", "Zenoh", "kernels", "disk", "clock"):
        assert f" {name}: " in done.stdout
    assert "→ plug the stage in" in done.stdout
    as_json = json.loads(CliRunner().invoke(app, ["doctor", "-c", str(config), "--json"]).stdout)
    assert {"name", "state", "finding", "remedy"} == set(as_json[0])


def test_a_cluster_is_looked_at_where_it_is_configured() -> None:
    assert list(check_cluster(PLAIN)) == []
    away = FusionSection(executor="cluster", cluster="tcp://127.0.0.1:9")
    check = only(check_cluster(Configuration(fusion=away)))
    assert (check.state, "bursts are fused on this machine: tcp://127.0.0.1:9" in check.finding) == (
        "warning",
        True,
    )
    assert "dask scheduler" in check.remedy


@pytest.mark.slow
def test_a_cluster_that_is_there_is_fine(tmp_path: Path) -> None:
    with dask_cluster(tmp_path / "dask", 1) as cluster:
        there = FusionSection(executor="cluster", cluster=cluster.address)
        check = only(check_cluster(Configuration(fusion=there)))
    assert (check.state, check.finding) == ("ok", f"{cluster.address}: 1 workers of this version")
