"""What the service adds to the solver.

`python tests/benchmarks/daemon_rates.py [--minutes 1] [--only stream,scan,once,command,commands]`

Each row runs the command `lidarboost run` as a user would, with a subscriber in a process of its own:

- stream: a simulated camera at 4.75 ms (50 frames/s), recording raw frames; frames lost, maps per second;
- scan: bursts of 15 frames at 5 ms, recording; from the last exposure to the map decoded by the subscriber,
  what of that is not the solver's, and whether the fusion keeps up;
- once: a long recording as fast as it goes, with and without pictures, in times real time;
- command: `run --replay recordings/wedges.mcap --once`, whole, with picture, caches warm;
- commands: how soon such are answered that touch no device, under full load, and with a stuck camera.

Run it on an idle machine; targets are in the heads of the columns.
"""

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from commanded import answers, told

ROOT = Path(__file__).parents[2]
LIDARBOOST = (sys.executable, "-m", "lidarboost")

SUBSCRIBER = """
import json, sys, time
from lidarboost import Client
ends, seen, last = {}, {}, {}
with Client(sys.argv[1]) as rig:
    def framed(message):
        fields = message.value
        if fields["burst"] is not None:
            half = 2e9 * (fields["integration_time"] or 0.0)
            ends[fields["burst"]] = max(ends.get(fields["burst"], 0), fields["timestamp"] + half)
    def mapped(message):
        seen[message.timestamp] = time.time_ns()
    def reported(message):
        last.update(message.value)
        report = message.value
        at = seen.get(report["timestamp"])
        end = ends.get(report["burst"])
        if at is not None and end is not None:
            solver = report["seconds"]["registration"] + report["seconds"]["solve"]
            print(json.dumps([(at - end) / 1e9, solver]), flush=True)
    rig.subscribe("camera/frame", framed)
    rig.subscribe("fused/depth", mapped)
    rig.subscribe("fused/report", reported)
    print("ready", flush=True)
    sys.stdin.read()
"""


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


def served(folder: Path, seconds: float, *lines: str) -> tuple[dict[str, Any], list[list[float]]]:
    """Run a daemon for so long; its summary, and what the subscriber saw: [latency, solver's seconds]."""
    with rig(folder, *lines) as (endpoint, config):
        command = [*LIDARBOOST, "run", str(config), "--json"]
        subscribe = [sys.executable, "-c", SUBSCRIBER, endpoint]
        with (
            subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as service,
            subprocess.Popen(
                subscribe, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            ) as subscriber,
        ):
            assert subscriber.stdout is not None
            assert subscriber.stdout.readline() == "ready\n"
            time.sleep(seconds)
            service.send_signal(signal.SIGTERM)
            said, _ = service.communicate(timeout=60)
            heard, _ = subscriber.communicate("")
    return json.loads(said), [json.loads(line) for line in heard.splitlines()]


CAMERA = ("[camera]", 'backend = "simulated"', "[camera.settings]")


def stream(folder: Path, seconds: float) -> Iterator[str]:
    """A map for every frame, as fast as it goes."""
    summary, _ = served(
        folder,
        seconds,
        'start = "stream"',
        *CAMERA,
        "integration_time = 0.00475",
        "[fusion]",
        'method = "lidarboost"',
        "[recording]",
        "enabled = true",
        "maps = false",
        f'directory = "{folder / "kept"}"',
    )
    rate = summary["maps"] / summary["seconds"]
    yield (
        f"stream lidarboost: {summary['frames']} frames, {summary['dropped_frames']} lost before the fusion "
        f"(0), {rate:.1f} maps/s over the whole run (20), lost: {summary['lost'] or 'nothing'}"
    )


def scan(folder: Path, seconds: float) -> Iterator[str]:
    """Bursts of a simulated camera on a simulated stage."""
    for method, target in (("lidarboost", "0.18 s"), ("phasor", "solver + 0.1 s")):
        place = folder / method
        place.mkdir()
        summary, heard = served(
            place,
            seconds,
            *CAMERA,
            "integration_time = 0.005",
            "[stage]",
            'backend = "simulated"',
            "settle = 0.0",
            "[fusion]",
            f'method = "{method}"',
            "[recording]",
            "enabled = true",
            f'directory = "{place / "kept"}"',
        )
        late, solver = (median(row[place] for row in heard) for place in (0, 1)) if heard else (0.0, 0.0)
        yield (
            f"scan {method}: {summary['maps']} of {summary['bursts']} bursts fused; last exposure to map "
            f"decoded {late:.3f} s ({target}), of which solver {solver:.3f} s, "
            f"service {late - solver:.3f} s (0.05)"
        )


def once(folder: Path, bursts: int = 40) -> Iterator[str]:
    """A long recording to its end."""
    recording = folder / "long.mcap"
    subprocess.run(
        [*LIDARBOOST, "simulate", "-o", str(recording), "--bursts", str(bursts)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    played = bursts * 15 * 0.121
    for method in ("lidarboost", "phasor"):
        for pictures in (False, True):
            seconds = _once(folder, recording, method, pictures)
            yield (
                f"once {method}{' with pictures' if pictures else ''}: {seconds:.1f} s for {bursts} bursts, "
                f"{played / seconds:.1f} times real time"
            )


def _once(folder: Path, recording: Path, method: str, pictures: bool) -> float:
    with rig(folder, "[fusion]", f'method = "{method}"') as (_, config):
        words = [*LIDARBOOST, "run", str(config), "--replay", str(recording), "--once", "--json"]
        if pictures:
            words += ["--output", str(folder / f"out-{method}")]
        said = subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return float(json.loads(said)["seconds"])


def command(folder: Path, runs: int = 5) -> Iterator[str]:
    """The README's first command, installed and warm."""
    taken = []
    for number in range(runs):
        with rig(folder) as (_, config):
            began = time.monotonic()
            subprocess.run(
                [
                    *LIDARBOOST,
                    "run",
                    str(config),
                    "--replay",
                    "recordings/wedges.mcap",
                    "--once",
                    "--output",
                    str(folder / f"out-{number}"),
                ],
                cwd=ROOT,
                check=True,
                capture_output=True,
            )
            taken.append(time.monotonic() - began)
    yield f"command: {min(taken):.1f}, {median(taken):.1f}, {max(taken):.1f} s least, median, most (3)"


def commands(folder: Path) -> Iterator[str]:
    """Asked from outside while it idles, while it scans and fuses, and while its camera is stuck."""
    for situation in ("idle", "scanning and fusing", "with a stuck camera"):
        place = folder / situation.replace(" ", "-")
        place.mkdir()
        lines = (
            f'start = "{"idle" if situation == "idle" else "scan"}"',
            *CAMERA,
            "integration_time = 0.005",
            "[stage]",
            'backend = "simulated"',
            "settle = 0.0",
            "[fusion]",
            'method = "lidarboost"',
            "[recording]",
            "enabled = true",
            f'directory = "{place / "kept"}"',
        )
        with rig(place, *lines) as (endpoint, config):
            yield from told(answers(config, endpoint, ROOT, stuck="stuck" in situation), situation)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--minutes", type=float, default=1.0, help="for how long a daemon runs; 10 for the targets"
    )
    parser.add_argument(
        "--only", default="stream,scan,once,command,commands", help="rows, with commas between"
    )
    chosen = parser.parse_args()
    rows = {
        "stream": lambda folder: stream(folder, 60 * chosen.minutes),
        "scan": lambda folder: scan(folder, 60 * chosen.minutes),
        "once": once,
        "command": command,
        "commands": commands,
    }
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    for name in chosen.only.split(",") if chosen.only else rows:
        with tempfile.TemporaryDirectory() as folder:
            for line in rows[name](Path(folder)):
                print(line, flush=True)


if __name__ == "__main__":
    main()
