"""The USB camera through the real libusb: umockdev puts a simulated SR4000 behind usbfs."""

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
WRAPPER, PYTHON = shutil.which("umockdev-wrapper"), "/usr/bin/python3"


def has_umockdev() -> bool:
    if WRAPPER is None or not Path(PYTHON).exists():
        return False
    check = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
    return subprocess.run([PYTHON, "-c", check], capture_output=True, check=False).returncode == 0


pytestmark = pytest.mark.skipif(not has_umockdev(), reason="needs umockdev, its introspection and python3-gi")


def behind_libusb(unplug_at: int, *command: object) -> str:
    """What a command prints that is run with the camera plugged in."""
    done = subprocess.run(
        [WRAPPER, PYTHON, HERE / "umockdev_host.py", "0.01", str(unplug_at), *map(str, command)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[1])},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def capture(frames: int, unplug_at: int = 0) -> dict:
    return json.loads(behind_libusb(unplug_at, sys.executable, HERE / "umockdev_client.py", frames))


def test_frames_come_through_libusb():
    result = capture(60)
    assert (result["good"], result["wrong"], result["errors"]) == (60, 0, [])
    assert result["serial"] == "4000002F"


def test_replugging_is_survived():
    result = capture(30, unplug_at=10)
    assert (result["good"], result["wrong"]) == (30, 0)
    assert "unplugged" in result["errors"][0]
    assert result["recovered"] < 3  # it is away for half a second of these


def test_the_whole_service_runs_on_it(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    zenoh, configuration = tmp_path / "zenoh.json5", tmp_path / "rig.toml"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    configuration.write_text(
        'camera = { backend = "usb", options = { allow_inferred = true } }\n'
        'fusion = { method = "nearest", upsampling = 2, register_poses = false, frames = 3 }\n'
        f'zenoh = {{ config = "{zenoh}" }}\n'
    )
    command = (
        sys.executable,
        "-m",
        "lidarboost",
        "run",
        configuration,
        "--once",
        "--output",
        tmp_path / "out",
    )
    assert "3 frames of SR4000 (device), 1 bursts, 1 maps" in behind_libusb(0, *command)
    assert (tmp_path / "out" / "fused.mcap").stat().st_size > 100_000
