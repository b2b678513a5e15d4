"""The USB camera through the real libusb: umockdev puts a simulated SR4000 behind usbfs."""

import json
import os
import shutil
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


def capture(frames: int, unplug_at: int = 0) -> dict:
    command = [sys.executable, HERE / "umockdev_client.py", str(frames)]
    done = subprocess.run(
        [WRAPPER, PYTHON, HERE / "umockdev_host.py", "0.01", str(unplug_at), *command],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[1])},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_frames_come_through_libusb():
    result = capture(60)
    assert (result["good"], result["wrong"], result["errors"]) == (60, 0, [])
    assert result["serial"] == "4000002F"


def test_replugging_is_survived():
    result = capture(30, unplug_at=10)
    assert (result["good"], result["wrong"]) == (30, 0)
    assert "unplugged" in result["errors"][0]
    assert result["recovered"] < 3  # it is away for half a second of these
