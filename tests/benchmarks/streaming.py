"""How many maps a stream gives per second: `python tests/benchmarks/streaming.py [--window 15]`.

The frames of a bundled recording go round and round through `SlidingFusion`, each registered with the ones
before it from the stage's angles; the first window is not counted. Run it on an idle machine.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from service.fusion.fusion import stack
from solver import FusionOptions, SlidingFusion
from solver.options import Method

RECORDING = Path(__file__).parents[2] / "recordings" / "wedges.mcap"
METHODS: tuple[Method, ...] = ("lidarboost", "area", "phasor")


def measure(method: Method, window: int, maps: int) -> tuple[float, float, float, float]:
    """Medians over some maps: seconds, of them registration, iterations; then the RMS error, metres."""
    recording = open_recording(RECORDING)
    frames = list(recording.frames())
    distance, amplitude = stack(frames, recording.calibration)
    turns = relative_rotations([(f.pan, f.tilt) for f in frames], recording.calibration.mount)
    noise = recording.calibration.noise
    stream = SlidingFusion(
        FusionOptions(method=method),
        window=window,
        ambiguity_range=frames[0].ambiguity_range,
        intrinsics=recording.calibration.intrinsics.matrix,
        distortion=recording.calibration.distortion or None,
        noise=None if noise is None else noise.for_signal(frames[0].integration_time),
    )
    taken = []
    for number in range(window + maps):
        k = number % len(frames)
        begin = time.perf_counter()
        fused = stream.push(distance[k], amplitude[k], initial=turns[k])
        taken.append(
            (time.perf_counter() - begin, fused.report.seconds.registration, fused.report.iterations)
        )
    error = fused.distance - recording.truth
    seconds, registration, iterations = np.median(taken[window:], axis=0)
    return float(seconds), float(registration), float(iterations), float(np.sqrt(np.nanmean(error**2)))


def main() -> None:
    """Measure every method and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--window", type=int, default=15)
    parser.add_argument("--maps", type=int, default=30, help="maps that are timed")
    chosen = parser.parse_args()
    print("method        maps/s   a map  registration  iterations  RMS error")
    for method in METHODS:
        print(f"{method} …", file=sys.stderr)
        seconds, registration, iterations, error = measure(method, chosen.window, chosen.maps)
        print(
            f"{method:<12} {1 / seconds:>7.1f} {1e3 * seconds:>5.0f} ms {1e3 * registration:>10.0f} ms "
            f"{iterations:>11.0f} {1e3 * error:>7.1f} mm"
        )


if __name__ == "__main__":
    main()
