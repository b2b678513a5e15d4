"""What wrong samples do to a map: `python tests/benchmarks/disturbances.py [--method NAME] [--seeds 3]`.

The bundled recordings are fused as they are and with something added that is not in the scene: somebody close
by in one frame or walking through five, wild samples, and one frame that is mirrored, so that it contradicts
the others everywhere. Poses are registered from the disturbed frames and the stage's angles; with the
mirrored one, which registration would reject, those of the undisturbed frames are given as exact. One table:
RMS and mean absolute errors in mm and the part of the samples that was left out as contradicted, means over
the seeds.
"""

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from regularization import RECORDINGS, ROOT, Case, recorded

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from solver import FusionOptions, fuse
from solver.evaluation import errors
from solver.options import Method

METHODS: tuple[Method, ...] = ("shift-and-add", "lidarboost", "area", "phasor")
CLOSE, SIZE = 1.0, (60, 40)  # metres, pixels
WILD = 0.002

Image = NDArray[np.float32]
Disturbance = Callable[[Image, np.random.Generator], None]


def _person(frame: Image, left: int, random: np.random.Generator) -> None:
    frame[50 : 50 + SIZE[0], left : left + SIZE[1]] = CLOSE + random.normal(0, 0.01, SIZE)


def _standing(frames: Image, random: np.random.Generator) -> None:
    _person(frames[random.integers(1, len(frames))], 60, random)


def _walking(frames: Image, random: np.random.Generator) -> None:
    for step, number in enumerate(random.choice(np.arange(1, len(frames)), 5, replace=False)):
        _person(frames[number], 25 * step, random)


def _wild(frames: Image, random: np.random.Generator) -> None:
    hit = random.random(frames.shape) < WILD
    frames[hit] = random.uniform(0.3, 7, int(hit.sum()))


def _mirrored(frames: Image, random: np.random.Generator) -> None:
    number = random.integers(1, len(frames))
    frames[number] = frames[number, :, ::-1]


DISTURBANCES: dict[str, Disturbance | None] = {
    "none": None,
    "somebody in one frame": _standing,
    "somebody in five": _walking,
    f"{100 * WILD:g} % wild samples": _wild,
    "one frame mirrored": _mirrored,
}


def stage_angles(scene: str) -> NDArray[np.float64]:
    """(N, 3) rotations as the stage reports them, which err by its pointing."""
    recording = open_recording(ROOT / "recordings" / f"{scene}.mcap")
    angles = [(frame.pan, frame.tilt) for frame in recording.frames()]
    return relative_rotations(angles, recording.calibration.mount)


def measure(case: Case, method: Method, name: str, seeds: int) -> tuple[float, float, float]:
    """RMS and mean absolute error in mm, and the contradicted part."""
    disturb, found = DISTURBANCES[name], []
    for seed in range(seeds if disturb else 1):
        given: dict[str, Any] = {**case.given, "distance": case.given["distance"].copy()}
        if disturb:
            disturb(given["distance"], np.random.default_rng(seed))
        if disturb is not _mirrored:
            del given["rotations"]
            given["initial"] = stage_angles(case.scene)
        fused = fuse(options=FusionOptions(method=method, **case.options), **given)
        error = errors(fused.distance, case.truth)
        found.append((error.rmse * case.scale, error.mae * case.scale, fused.report.contradicted))
    rms, mae, part = np.array(found).T
    return float(np.sqrt(np.mean(rms**2))), float(mae.mean()), float(part.mean())


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", action="append", choices=METHODS, help="only this; repeatable")
    parser.add_argument("--seeds", type=int, default=3, help="draws of each disturbance")
    chosen = parser.parse_args()
    if chosen.seeds < 1:
        parser.error(f"--seeds is {chosen.seeds}; expected at least 1")
    print("scene    disturbance             method         RMS mm  mean abs. mm  contradicted")
    for scene in RECORDINGS:
        case = next(recorded(scene, 1))
        for name in DISTURBANCES:
            for method in chosen.method or METHODS:
                rms, mae, part = measure(case, method, name, chosen.seeds)
                print(
                    f"{scene:<8} {name:<23} {method:<13} {rms:>7.1f} {mae:>13.1f} {part:>13.3%}", flush=True
                )


if __name__ == "__main__":
    main()
