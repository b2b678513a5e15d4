"""What the service adds to the solver.

`python tests/benchmarks/daemon_rates.py [--minutes 1] [--only stream,ros,scan,record,once,command,commands]`

Each row runs the command `lidarboost run` as a user would, with a subscriber in a process of its own:

- stream: a simulated camera at 4.75 ms (50 frames/s), recording raw frames; frames lost, maps per second once
  the window has been full twice, and how long the first map and that took;
- ros: the same stream, not recorded, with the sink of ROS 2; a client of ROS 2 that is not ours counts the
  depth images of frames and of maps that reach it, by the numbers that they bear;
- scan: bursts of 15 frames at 5 ms, recording; from the last exposure to the map decoded by the subscriber,
  what of that is not the solver's, and whether the fusion keeps up;
- record: bursts of a camera that nothing turns, recorded, fused and drawn; frames dropped, and how long the
  machine itself stood still, which nothing can make up for;
- once: a long recording as fast as it goes, with and without pictures, in times real time;
- command: `run --replay recordings/wedges.mcap --once`, whole, with picture, caches warm;
- commands: how soon such are answered that touch no device, under full load, and with a stuck camera.

Run it on an idle machine; targets are in the heads of the columns.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from commanded import answers, told
from pauses import Pauses
from served import LIDARBOOST, ROOT, ROS_SUBSCRIBER, listened, rig, served

from drivers.recording import open_recording

WARM = 30
"""Maps until the window of a stream has been full twice: its first frames are solved from nothing."""


PERIOD = 0.02
"""Seconds from frame to frame of the camera at 4.75 ms."""


CAMERA = ("[camera]", 'backend = "simulated"', "[camera.settings]")


STREAM = (
    'start = "stream"',
    *CAMERA,
    "integration_time = 0.00475",
    "[fusion]",
    'method = "lidarboost"',
)


def stream(folder: Path, seconds: float) -> Iterator[str]:
    """A map for every frame, as fast as it goes."""
    summary, heard = served(
        folder,
        seconds,
        *STREAM,
        "[recording]",
        "enabled = true",
        "maps = false",
        f'directory = "{folder / "kept"}"',
    )
    warm = heard[WARM:]
    rate = (len(warm) - 1) / (warm[-1].at - warm[0].at) if len(warm) > 1 else 0.0
    solver = median(one.solver for one in warm) if warm else 0.0
    yield (
        f"stream lidarboost: {summary['frames']} frames, {summary['dropped_frames']} lost before the fusion "
        f"(0), {rate:.1f} maps/s (20), solver {1e3 * solver:.0f} ms a map; "
        f"first map after {heard[0].at:.1f} s, "
        f"{WARM} maps after {heard[min(WARM, len(heard)) - 1].at:.1f} s; "
        f"lost: {summary['lost'] or 'nothing'}"
    )


def ros(folder: Path, seconds: float) -> Iterator[str]:
    """A stream that nodes of ROS 2 hear."""
    summary, heard = listened(folder, seconds, ROS_SUBSCRIBER, *STREAM, "[ros2]", "enabled = true")
    warm = heard[WARM:]
    rate = (len(warm) - 1) / (warm[-1][0] - warm[0][0])
    (frames, frames_sent), (maps, maps_sent), size = heard[-1][1:]
    yield (
        f"stream with ROS 2: {summary['frames']} frames, {summary['dropped_frames']} lost before the fusion "
        f"(0); {rate:.1f} maps/s (20) of {size} bytes received; arrived {frames} of {frames_sent} depth "
        f"images of frames, {maps} of {maps_sent} of maps; lost: {summary['lost'] or 'nothing'}"
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
        late = median(one.late for one in heard if one.late is not None)
        solver = median(one.solver for one in heard)
        yield (
            f"scan {method}: {summary['maps']} of {summary['bursts']} bursts fused, a map every "
            f"{(heard[-1].at - heard[0].at) / (len(heard) - 1):.2f} s; last exposure to map "
            f"decoded {late:.3f} s ({target}), of which solver {solver:.3f} s, "
            f"service {late - solver:.3f} s (0.05)"
        )


def record(folder: Path, seconds: float) -> Iterator[str]:
    """Bursts of 15 frames of a camera that nothing turns, with pictures: every frame is to be recorded."""
    kept = folder / "kept"
    with Pauses(PERIOD) as pauses:
        summary, heard = served(
            folder,
            seconds,
            *CAMERA,
            "integration_time = 0.00475",
            "[fusion]",
            'method = "lidarboost"',
            "[recording]",
            "enabled = true",
            f'directory = "{kept}"',
            output=folder / "out",
        )
    recorded = sum(open_recording(path).frame_count for path in kept.glob("*.mcap"))
    pictures = sum(1 for _ in (folder / "out").glob("*.png"))
    yield (
        f"record: {summary['frames']} frames, {summary['dropped_frames']} dropped by the camera (0), "
        f"{recorded} recorded; {summary['maps']} of {summary['bursts']} bursts fused, {len(heard)} maps "
        f"received, {pictures} pictures; the machine stood still "
        f"{len(pauses.late)} times for over {1e3 * PERIOD:.0f} ms, {1e3 * sum(pauses.late):.0f} in all; "
        f"lost: {summary['lost'] or 'nothing'}"
    )


def once(folder: Path, bursts: int = 120) -> Iterator[str]:
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
        "--only", default="stream,ros,scan,record,once,command,commands", help="rows, with commas between"
    )
    chosen = parser.parse_args()
    rows = {
        "stream": lambda folder: stream(folder, 60 * chosen.minutes),
        "ros": lambda folder: ros(folder, 60 * chosen.minutes),
        "scan": lambda folder: scan(folder, 60 * chosen.minutes),
        "record": lambda folder: record(folder, 60 * chosen.minutes),
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
