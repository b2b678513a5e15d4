"""The service in a process of its own, with a simulated rig that is fast, and what it says."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import zenoh

ROOT = Path(__file__).parents[2]
PREFIX = "lidarboost/rig"
FAST = """
[camera]
backend = "simulated"
options = { scene = "plane" }
settings = { integration_time = 0.02 }
[fusion]
method = "nearest"
register_poses = false
frames = 3
upsampling = 2
[plan]
span = 0
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait_until(condition: Callable[[], bool], seconds: float, what: str) -> float:
    """Seconds until a condition holds; fails after the time given."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() < began + seconds, f"not within {seconds:g} s: {what}"
        time.sleep(0.02)
    return time.monotonic() - began


class Daemon:
    """One that runs: its process, its endpoint and what it has printed so far."""

    def __init__(self, process: "subprocess.Popen[bytes]", endpoint: str, log: Path) -> None:
        self.process, self.endpoint, self._log = process, endpoint, log

    @property
    def log(self) -> str:
        return self._log.read_text(encoding="utf-8", errors="replace")

    def stop(self, seconds: float = 60.0) -> float:
        """Tell it to, and wait until it has; seconds that took."""
        began = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(seconds) in (0, 3), self.log  # 3: something was lost on the way
        return time.monotonic() - began


@contextmanager
def daemon(
    folder: Path,
    zenoh_config: str = "{}",
    configuration: str = "",
    environment: dict[str, str] | None = None,
) -> Iterator[Daemon]:
    """A daemon that listens on a free port of loopback.

    Args:
        folder: for its files.
        zenoh_config: JSON5, into whose first braces that port is written.
        configuration: TOML that goes before the rig's.
        environment: in addition to what is.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    listen = f'{{ listen: {{ endpoints: ["{endpoint}"] }},'
    before, _, after = zenoh_config.partition("\n{") if "\n{" in zenoh_config else ("", "", zenoh_config[1:])
    file, rig, log = folder / "zenoh.json5", folder / "rig.toml", folder / "log.txt"
    file.write_text(f"{before}\n{listen}{after}", encoding="utf-8")
    rig.write_text(f'{configuration}\n[zenoh]\nconfig = "{file}"\n{FAST}', encoding="utf-8")
    command = [sys.executable, "-c", "from service.entry import main; main()", "run", str(rig)]
    with log.open("wb") as out:
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=out, stderr=subprocess.STDOUT, env=os.environ | (environment or {})
        )
    try:
        yield Daemon(process, endpoint, log)
    finally:
        process.kill()
        process.wait()


class Ear:
    """A plain subscriber to everything of a rig; when each message came, by topic."""

    def __init__(self, endpoint: str, prefix: str = PREFIX) -> None:
        config = zenoh.Config()
        for key, value in {
            "mode": '"peer"',
            "listen/endpoints": "[]",
            "scouting/multicast/enabled": "false",
            "scouting/gossip/enabled": "false",
            "connect/endpoints": json.dumps([endpoint]),
            "connect/retry": "{period_init_ms: 50, period_max_ms: 200, period_increase_factor: 2}",
        }.items():
            config.insert_json5(key, value)
        self._prefix = prefix
        self.came: dict[str, list[float]] = {}
        self.status: dict[str, Any] = {}
        self.session = zenoh.open(config)
        self._declared = self.session.declare_subscriber(f"{prefix}/**", self._arrived)

    def _arrived(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).removeprefix(f"{self._prefix}/")
        self.came.setdefault(topic, []).append(time.monotonic())
        if topic == "status":
            self.status = json.loads(sample.payload.to_bytes())

    def count(self, topic: str) -> int:
        return len(self.came.get(topic, ()))

    def hears(self, topic: str, seconds: float = 120.0, more: int = 3) -> float:
        """Seconds until so many more messages of a topic have come."""
        before = self.count(topic)
        return wait_until(lambda: self.count(topic) >= before + more, seconds, topic)

    def longest_gap(self, topic: str, since: float) -> float:
        """Seconds without a message of a topic, at most, from a time (monotonic) until now."""
        times = [since, *(at for at in self.came.get(topic, ()) if at > since), time.monotonic()]
        return max(after - before for before, after in pairwise(times))

    def close(self) -> None:
        self._declared.undeclare()  # type: ignore[no-untyped-call]
        self.session.close()  # type: ignore[no-untyped-call]


@contextmanager
def ear(endpoint: str, prefix: str = PREFIX) -> Iterator[Ear]:
    one = Ear(endpoint, prefix)
    try:
        yield one
    finally:
        one.close()


@contextmanager
def reader(endpoint: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A subscriber to everything in a process of its own, which signals may stop; it says when maps come."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[2]); from daemons import ear\n"
        "import time\n"
        "with ear(sys.argv[1]) as one:\n"
        "    while True:\n"
        "        one.hears('fused/depth', 3600, 1); print('map', flush=True)\n"
    )
    command = [sys.executable, "-c", script, endpoint, str(Path(__file__).parent)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


ROUTER = """
import sys, zenoh
with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
    print("up", flush=True)
    sys.stdin.read()
"""


@contextmanager
def router(file: Path) -> Iterator["subprocess.Popen[str]"]:
    """A router by a Zenoh file, in a process of its own."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-c", ROUTER, str(file)], text=True, **pipes)  # type: ignore[call-overload]
    try:
        assert process.stdout.readline() == "up\n"
        yield process
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            pipe.close()
