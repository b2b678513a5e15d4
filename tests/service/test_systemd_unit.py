"""The service as systemd runs it: its unit, and what it says through the notification socket."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from service.config.sections import CameraSection

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "deploy" / "lidarboost.service"
RUN = [sys.executable, "-c", "from service.entry import main; main()", "run"]


def settings() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in UNIT.read_text(encoding="utf-8").splitlines():
        if "=" in line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.setdefault(key, []).append(value)
    return found


def test_the_unit_says_what_the_service_keeps() -> None:
    found = settings()
    assert found["Type"] == ["notify"]
    assert found["RestartPreventExitStatus"] == ["2"]
    assert found["SuccessExitStatus"] == ["3"]
    assert found["ExecReload"] == ["/bin/kill -HUP $MAINPID"]
    bounds = CameraSection.model_fields["timeout"].metadata
    longest = next(bound.le for bound in bounds if hasattr(bound, "le"))
    assert int(found["WatchdogSec"][0]) > longest, "a camera that is silent gets the service killed"
    assert "MemoryDenyWriteExecute" not in found, "Numba compiles at run time"


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("there is no systemd-analyze here")
    unit = tmp_path / "lidarboost.service"
    text = UNIT.read_text(encoding="utf-8")
    unit.write_text(text.replace("/opt/lidarboost/bin/lidarboost", "/bin/true"), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    assert "lidarboost.service" not in done.stderr, done.stderr


@pytest.fixture
def said(tmp_path: Path) -> Iterator[socket.socket]:
    """What systemd would hear."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(60)
        yield listening


@pytest.fixture
def started(tmp_path: Path, endpoint: str) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts the service as systemd does: no HOME, no language, nothing else of ours."""
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    rig = tmp_path / "rig.toml"
    rig.write_text(
        f'[zenoh]\nconfig = "{zenoh}"\n'
        '[camera]\nbackend = "simulated"\n'
        'options = { scene = "plane" }\nsettings = { integration_time = 0.002 }\n'
        '[fusion]\nmethod = "nearest"\nregister_poses = false\nframes = 3\nupsampling = 1\n'
        "[plan]\nspan = 0\n"
    )
    running: list[subprocess.Popen[str]] = []

    def start(*prefix: str, **environment: str) -> "subprocess.Popen[str]":
        known = {"PATH": os.environ["PATH"], "LANG": "C", "NOTIFY_SOCKET": str(tmp_path / "notify")}
        service = subprocess.Popen(
            [*prefix, *RUN, str(rig)],
            cwd=ROOT,
            env=known | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        running.append(service)
        return service

    yield start
    for service in running:
        if service.poll() is None:
            service.kill()
        service.communicate()


def until(said: socket.socket, wanted: str, service: "subprocess.Popen[str]") -> list[str]:
    heard: list[str] = []
    deadline = time.monotonic() + 150
    while time.monotonic() < deadline:
        try:
            heard += said.recv(4096).decode().splitlines()
        except TimeoutError:
            continue
        if wanted in heard:
            return heard
        assert service.poll() is None, service.communicate()[0]
    pytest.fail(f"no {wanted} in {heard}")


def test_it_says_ready_then_that_it_lives_then_that_it_stops(started, said: socket.socket) -> None:
    service = started()
    heard = until(said, "READY=1", service)
    assert any(line.startswith("STATUS=starting") for line in heard)
    for _ in range(2):
        until(said, "WATCHDOG=1", service)
    began = time.monotonic()
    service.send_signal(signal.SIGTERM)
    until(said, "STOPPING=1", service)
    output, _ = service.communicate(timeout=60)
    assert service.returncode == (3 if "lost:" in output else 0), output
    assert time.monotonic() - began < 10
    assert "Traceback" not in output


@pytest.mark.faults
def test_read_only_packages_and_no_home_are_enough(started, said: socket.socket, tmp_path: Path) -> None:
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode:
        pytest.skip("file systems cannot be mounted here")
    folders = {str(ROOT), str(Path(os.__file__).parent), str(Path(pytest.__file__).parents[1])}
    frozen = " && ".join(
        f"mount --bind {folder} {folder} && mount -o remount,bind,ro {folder}" for folder in sorted(folders)
    )
    cache = tmp_path / "cache"
    shell = ["unshare", "-rm", "sh", "-c", f'{frozen} && exec "$@"', "sh"]
    service = started(*shell, NUMBA_CACHE_DIR=str(cache), TMPDIR=str(tmp_path))
    until(said, "READY=1", service)
    service.send_signal(signal.SIGTERM)
    output, _ = service.communicate(timeout=60)
    assert service.returncode == 0, output
    assert "Traceback" not in output


def test_a_configuration_that_cannot_be_used_ends_with_two(started, said, tmp_path: Path) -> None:  # noqa: ARG001
    service = started(LIDARBOOST_FUSION__METHOD="areaa")
    output, _ = service.communicate(timeout=60)
    assert service.returncode == 2
    assert output.startswith("error: environment variable LIDARBOOST_FUSION__METHOD: fusion.method")
