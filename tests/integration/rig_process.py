"""`lidarboost run` in a process of its own, and a stranger who commands it."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "service"))

from commanding import Stranger  # noqa: E402

SIMULATED = """
[camera]
backend = "simulated"
[stage]
backend = "simulated"
"""

PLUGGED = """
[camera]
backend = "usb"
options = { allow_inferred = true }
timeout = 0.5
"""
"""The camera of `plugged_camera.py`."""

COMMON = """
start = "{start}"
{devices}
[fusion]
method = "nearest"
upsampling = 2
register_poses = false
frames = 5
[recording]
enabled = true
directory = "{folder}/disk/recordings"
rotate_size = 8
budget = 32
[zenoh]
config = "{folder}/zenoh.json5"
"""

_SERVICE = ("-m", "lidarboost")
_WITH_CAMERA = (str(Path(__file__).with_name("plugged_camera.py")),)


def free_endpoint() -> str:
    """A loopback endpoint that is free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class RigProcess:
    """A service at work.

    Attributes:
        process: its own; what it says goes to `log`.
    """

    def __init__(self, folder: Path, devices: str, start: str, text: str = COMMON) -> None:
        self.folder, self.endpoint = folder, free_endpoint()
        self.log, self.config = folder / "log.txt", folder / "rig.toml"
        (folder / "zenoh.json5").write_text(json.dumps({"listen": {"endpoints": [self.endpoint]}}))
        self.config.write_text(text.format(folder=folder, devices=devices, start=start))
        program = _WITH_CAMERA if devices.startswith(PLUGGED) else _SERVICE
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, *program, "run", str(self.config)],
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                text=True,
            )

    @cached_property
    def far(self) -> Stranger:
        """Somebody who commands it, once it listens."""
        return Stranger(self.endpoint)

    def tell_camera(self, word: str) -> None:
        """Have something happen to the camera; see `plugged_camera.py`."""
        assert self.process.stdin is not None
        print(word, file=self.process.stdin, flush=True)

    def ask(self, name: str, **request: Any) -> dict[str, Any]:
        """The reply to a command, or its `{"code", "message"}`."""
        return self.far.ask(name, **request)

    @property
    def status(self) -> dict[str, Any]:
        """The latest; empty while there is none."""
        replies = self.far.query("lidarboost/rig/status", timeout=2)
        found: dict[str, Any] = replies[0]["ok"] if replies else {}
        return found

    def wait(self, true: Callable[[dict[str, Any]], object], seconds: float = 60.0) -> dict[str, Any]:
        """The status, once something is true of it."""
        end = time.monotonic() + seconds
        while not (told := self.status) or not true(told):
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end, f"not so in time: {told}\n{self.log.read_text()}"
            time.sleep(0.05)
        return told

    def wait_state(self, state: str, seconds: float = 120.0) -> dict[str, Any]:
        """The status, once it is in a state."""
        return self.wait(lambda told: told["state"] == state, seconds)

    def end(self, number: int = signal.SIGTERM) -> float:
        """Send a signal; the seconds until it ended, with status 0, or 3 where it says that data was lost."""
        began = time.monotonic()
        self.process.send_signal(number)
        status = self.process.wait(30)
        seconds = time.monotonic() - began
        said = self.log.read_text()
        assert status == (3 if "lost:" in said else 0), said
        return seconds

    def close(self) -> None:
        self.process.kill()
        self.process.communicate(timeout=20)
        if "far" in vars(self):
            self.far.close()


@contextmanager
def rig_process(
    folder: Path, devices: str = SIMULATED, start: str = "idle", text: str = COMMON
) -> Iterator[RigProcess]:
    """A service that begins."""
    rig = RigProcess(folder, devices, start, text)
    try:
        yield rig
    finally:
        rig.close()
