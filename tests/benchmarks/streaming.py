"""How many maps a stream gives per second.

`python tests/benchmarks/streaming.py [--window 15] [--maps 64] [--json FILE]`: a simulated rig takes one
frame after another at poses of its own; `SlidingFusion` registers each with those before it from the stage's
angles and fuses the last window. The first two windows are not counted: in the first one data are few, and
in the second one arrays grow. Now and then all passes run (see `stream.window`); the rate counts them, and
the longest map is one of them. The errors are those of all counted maps, and of `fuse` on the last window's
frames. Run it on an idle machine.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from stored import store

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from service.cli.simulate import simulate
from service.fusion.fuse import stack
from solver import Fused, FusionOptions, SlidingFusion, fuse
from solver.options import Method

METHODS: tuple[Method, ...] = ("lidarboost", "area", "phasor")

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Stream:
    """Frames (N, H, W), first guesses of their rotations (N, 3), what the solver is told, and the truth."""

    distance: np.ndarray
    amplitude: np.ndarray
    turns: np.ndarray
    known: dict[str, Any]
    truth: np.ndarray

    @classmethod
    def simulated(cls, scene: str, frames: int) -> "Stream":
        """A burst as long as the stream."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "stream.mcap"
            simulate(path, scene=scene, frames=frames, span=15.0 if scene == "wedges" else 30.0)
            recording = open_recording(path)
            taken, truth = list(recording.frames()), recording.truth
        calibration = recording.calibration
        distance, amplitude = stack(taken, calibration)
        known = {
            "ambiguity_range": taken[0].ambiguity_range,
            "intrinsics": calibration.intrinsics.matrix,
            "distortion": calibration.distortion or None,
            "noise": calibration.noise.for_signal(taken[0].integration_time),
        }
        turns = relative_rotations([(f.pan, f.tilt) for f in taken], calibration.mount)
        return cls(distance, amplitude, turns, known, truth)

    def error(self, fused: Fused) -> tuple[float, float]:
        """RMS and mean absolute error, metres."""
        wrong = fused.distance - self.truth
        return float(np.sqrt(np.nanmean(wrong**2))), float(np.nanmean(np.abs(wrong)))


def measure(stream: Stream, scene: str, method: Method, window: int) -> Row:
    """Maps a second, milliseconds of a map, and errors in mm (RMS, mean absolute)."""
    options = FusionOptions(method=method)
    sliding = SlidingFusion(options, window=window, **stream.known)
    taken, errors = [], []
    for number, frame in enumerate(stream.distance):
        begin = time.perf_counter()
        fused = sliding.push(frame, stream.amplitude[number], initial=stream.turns[number])
        seconds = time.perf_counter() - begin
        if number >= 2 * window:
            taken.append((seconds, fused.report.seconds.registration, fused.report.iterations))
            errors.append(stream.error(fused))
    used = list(fused.report.used)
    whole = fuse(
        stream.distance[used],
        stream.amplitude[used],
        rotations=fused.rotations,
        options=options,
        **stream.known,
    )
    each = np.array(taken)
    registration, iterations = np.median(each[:, 1:], axis=0)
    return {
        "scene": scene,
        "method": method,
        "rate": 1 / each[:, 0].mean(),
        "usual": 1e3 * float(np.median(each[:, 0])),
        "longest": 1e3 * each[:, 0].max(),
        "registering": 1e3 * registration,
        "iterations": int(iterations),
        "stream": [1e3 * float(value) for value in np.mean(errors, axis=0)],
        "fuse": [1e3 * value for value in stream.error(whole)],
    }


def line(row: Row) -> str:
    """As the table shows it."""
    wrong = "  ".join(f"{rms:>6.1f} / {mean:<6.1f}" for rms, mean in (row["stream"], row["fuse"]))
    return (
        f"{row['method']:<11} {row['rate']:>6.1f}  {row['usual']:>5.0f} {row['longest']:>8.0f} "
        f"{row['registering']:>12.0f} {row['iterations']:>11.0f}     {wrong}"
    )


def main() -> None:
    """Measure every method on both scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--window", type=int, default=15)
    parser.add_argument("--maps", type=int, default=64, help="maps that are counted")
    parser.add_argument("--method", action="append", choices=METHODS)
    parser.add_argument("--json", type=Path, help="store it here")
    chosen = parser.parse_args()
    rows = []
    for scene in ("wedges", "objects"):
        stream = Stream.simulated(scene, 2 * chosen.window + chosen.maps)
        print(f"\n{scene}        a map, ms                                 error RMS / mean, mm")
        print("method      maps/s  usual  longest  registering  iterations  of the stream    of `fuse`")
        for method in chosen.method or METHODS:
            print(f"{method} …", file=sys.stderr)
            rows.append(measure(stream, scene, method, chosen.window))
            print(line(rows[-1]), flush=True)
    if chosen.json:
        store(chosen.json, rows=rows)


if __name__ == "__main__":
    main()
