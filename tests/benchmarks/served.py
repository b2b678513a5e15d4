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


ROS_SUBSCRIBER = """
import json, os, struct, sys, time
sys.path.insert(0, "tests/service")
import pyzeros
from pyzeros.sub import RawSub
from ros_listener import stand_in
from ros_rig import client
numbers = {"camera/depth/image_raw": [], "fused/depth/image_rect": []}
def heard(name):
    def count(sample):
        numbers[name].append(struct.unpack_from("<q", sample.attachment.to_bytes())[0])
        if name.startswith("fused"):
            counts = [[len(of), of[-1] - of[0] + 1] if of else [0, 0] for of in numbers.values()]
            print(json.dumps([time.time(), *counts, len(sample.payload)]), flush=True)
    return count
session = client(sys.argv[1])
node = pyzeros.Node("independent", session=session, domain_id=0)
kind = stand_in("sensor_msgs/msg/Image")
kept = [RawSub(kind, "/lidarboost/" + name, heard(name), session=node) for name in numbers]
sys.stdin.read()
os._exit(0)
"""
"""A client of ROS 2 that is not ours: how many images of frames and of maps came, and how many were sent."""


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
    began = time.time()
    summary, rows = listened(folder, seconds, SUBSCRIBER, *lines, output=output)
    return summary, [Heard(at - began, late, solver) for at, late, solver in rows]


def listened(
    folder: Path, seconds: float, subscriber: str, *lines: str, output: Path | None = None
) -> tuple[dict[str, Any], list[list[Any]]]:
    """The same with a subscriber's code, which prints a row of JSON for every map."""
    with rig(folder, *lines) as (endpoint, config):
        command = [*LIDARBOOST, "run", str(config), "--json"]
        command += [] if output is None else ["--output", str(output)]
        subscribe = [sys.executable, "-c", subscriber, endpoint]
        lines_heard = folder / "heard.jsonl"
        with (
            lines_heard.open("w") as written,
            subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as service,
            subprocess.Popen(
                subscribe, cwd=ROOT, stdin=subprocess.PIPE, stdout=written, text=True
            ) as listener,
        ):
            while not lines_heard.stat().st_size:
                assert service.poll() is None, "the service ended before its first map"
                time.sleep(0.1)
            time.sleep(seconds)
            service.send_signal(signal.SIGTERM)
            said, _ = service.communicate(timeout=60)
            listener.communicate("")
    return json.loads(said), [json.loads(line) for line in lines_heard.read_text().splitlines()]
