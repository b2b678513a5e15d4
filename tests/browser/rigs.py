"""A simulated rig and its live page, each a process of its own, for tests that open the page."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

ROOT = Path(__file__).parents[2]

NEAR, FAR = 2.0, 2.5
"""Metres to the left and to the right half of the scene `step`."""

START = 300.0
"""Seconds until a rig is idle on a machine that has much else to do."""

CONFIG = """
start = "idle"
[camera]
backend = "simulated"
options = {{ scene = "{scene}", noise = {noise} }}
[stage]
backend = "simulated"
[fusion]
method = "{method}"
frames = {frames}
[recording]
directory = "{folder}/recordings"
[zenoh]
config = "{folder}/zenoh.json5"
"""


def free_port() -> int:
    """A port of loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Rig:
    """`lidarboost run` with a simulated camera, and `lidarboost view --web`.

    Attributes:
        url: of the page.
        recordings: the rig's folder.
        process: the rig.
    """

    def __init__(
        self,
        folder: Path,
        scene: str = "step",
        method: str = "nearest",
        frames: int = 4,
        noise: bool = False,
    ) -> None:
        self.folder, self.recordings = folder, folder / "recordings"
        self.recordings.mkdir(parents=True, exist_ok=True)
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        (folder / "zenoh.json5").write_text(json.dumps({"listen": {"endpoints": [self.endpoint]}}))
        given = {"scene": scene, "method": method, "frames": frames, "noise": str(noise).lower()}
        (folder / "rig.toml").write_text(CONFIG.format(folder=folder, **given))
        self.start()
        self.page = self._run(
            "view", "--web", "--endpoint", self.endpoint, "--port", "0", out=subprocess.PIPE
        )
        assert self.page.stdout is not None
        self.url = self.page.stdout.readline().decode().split()[-1]

    def start(self) -> None:
        """Start the rig, again after `kill`."""
        self.process = self._run("run", str(self.folder / "rig.toml"))

    def kill(self) -> None:
        """As a power cut does."""
        self.process.kill()
        self.process.wait(20)

    def close(self) -> None:
        """End both."""
        for process in (self.page, self.process):
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(20)
        if self.page.stdout is not None:
            self.page.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self, *arguments: str, out: int = subprocess.DEVNULL) -> "subprocess.Popen[bytes]":
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-m", "lidarboost", *arguments]
        return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=out, stderr=subprocess.DEVNULL)


def wait(true: Callable[[], bool], seconds: float = 60.0) -> float:
    """Until `true()` is; returns the seconds that took."""
    begun = time.monotonic()
    while not true():
        assert time.monotonic() - begun < seconds, f"not so within {seconds:g} s"
        time.sleep(0.02)
    return time.monotonic() - begun
