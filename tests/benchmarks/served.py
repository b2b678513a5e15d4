"""A service under way, and a subscriber in a process of its own."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LIDARBOOST = (sys.executable, "-m", "lidarboost")

SUBSCRIBER = """
import json, sys, time
from lidarboost import Client
ends, seen, solvers = {}, {}, {}
with Client(sys.argv[1]) as rig:
    def framed(message):
        fields = message.value
        if fields["burst"] is not None:
            half = 2e9 * (fields["integration_time"] or 0.0)
            ends[fields["burst"]] = max(ends.get(fields["burst"], 0), fields["timestamp"] + half)
    def mapped(message):
        message.value
        seen[message.timestamp] = time.time_ns()
        told(message.timestamp)
    def reported(message):
        report = message.value
        seconds = report["seconds"]["registration"] + report["seconds"]["solve"]
        solvers[report["timestamp"]] = report["burst"], seconds
        told(report["timestamp"])
    def told(stamp):
        # A map and its report overtake each other: the large one is sent in pieces.
        if stamp in seen and stamp in solvers:
            at, (burst, solver) = seen.pop(stamp), solvers.pop(stamp)
            end = ends.get(burst)
            print(json.dumps([at / 1e9, None if end is None else (at - end) / 1e9, solver]), flush=True)
    rig.subscribe("camera/frame", framed)
    rig.subscribe("fused/depth", mapped)
    rig.subscribe("fused/report", reported)
    sys.stdin.read()
"""


@dataclass(frozen=True, slots=True)
class Heard:
    """A map that the subscriber decoded: seconds since the command was begun, since the end of the last
    exposure (None in a stream), and those of its solver."""

    at: float
    late: float | None
    solver: float


@contextmanager
def rig(folder: Path, *lines: str) -> Iterator[tuple[str, Path]]:
    """An endpoint, and a configuration with these lines."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    (folder / "zenoh.json5").write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    config = folder / "rig.toml"
    config.write_text("\n".join([*lines, "[zenoh]", f'config = "{folder / "zenoh.json5"}"', ""]))
    yield endpoint, config


def served(
    folder: Path, seconds: float, *lines: str, output: Path | None = None
) -> tuple[dict[str, Any], list[Heard]]:
    """Run a daemon for so long after its first map; its summary, and what a subscriber saw.

    Args:
        folder: for its configuration.
        seconds: how long.
        lines: of its configuration.
        output: of its pictures and `fused.mcap`; None = neither.
    """
    with rig(folder, *lines) as (endpoint, config):
        command = [*LIDARBOOST, "run", str(config), "--json"]
        command += [] if output is None else ["--output", str(output)]
        subscribe = [sys.executable, "-c", SUBSCRIBER, endpoint]
        began = time.time()
        lines_heard = folder / "heard.jsonl"
        with (
            lines_heard.open("w") as written,
            subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as service,
            subprocess.Popen(
                subscribe, cwd=ROOT, stdin=subprocess.PIPE, stdout=written, text=True
            ) as subscriber,
        ):
            while not lines_heard.stat().st_size:
                assert service.poll() is None, "the service ended before its first map"
                time.sleep(0.1)
            time.sleep(seconds)
            service.send_signal(signal.SIGTERM)
            said, _ = service.communicate(timeout=60)
            subscriber.communicate("")
    rows = [json.loads(line) for line in lines_heard.read_text().splitlines()]
    return json.loads(said), [Heard(at - began, late, solver) for at, late, solver in rows]
