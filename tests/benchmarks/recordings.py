"""How far maps of the bundled recordings are from the truth.

`python tests/benchmarks/recordings.py [--json FILE]`: each method with its defaults, ×4, frames registered by
their images from the angles that the stage reported.
"""

import argparse
import warnings
from pathlib import Path
from typing import Any

from stored import ROOT, store

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from service.fusion.fuse import stack
from solver import FusionOptions, FusionWarning, fuse
from solver.evaluation import errors
from solver.options import Method

SCENES = "wedges", "objects"
METHODS: tuple[Method, ...] = ("nearest", "lidarboost", "area", "phasor")

Row = dict[str, Any]


def measured(scene: str) -> list[Row]:
    """A row by method; errors in mm."""
    recording = open_recording(ROOT / "recordings" / f"{scene}.mcap")
    frames, calibration = list(recording.frames()), recording.calibration
    distance, amplitude = stack(frames, calibration)
    noise = calibration.noise
    given = {
        "initial": relative_rotations([(f.pan, f.tilt) for f in frames], calibration.mount),
        "intrinsics": calibration.intrinsics.matrix,
        "distortion": calibration.distortion or None,
        "ambiguity_range": frames[0].ambiguity_range,
        "noise": None if noise is None else noise.for_signal(frames[0].integration_time),
    }
    rows = []
    for method in METHODS:
        found = fuse(distance, amplitude, options=FusionOptions(method=method), **given)
        wrong = errors(found.distance, recording.truth)
        row = {"scene": scene, "method": method, "rms": 1e3 * wrong.rmse, "mean": 1e3 * wrong.mae}
        print(f"{scene:<8} {method:<11} {row['rms']:6.1f} / {row['mean']:.1f} mm", flush=True)
        rows.append(row)
    return rows


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, help="store it here")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore", FusionWarning)
    rows = [row for scene in SCENES for row in measured(scene)]
    if chosen.json:
        store(chosen.json, rows=rows)


if __name__ == "__main__":
    main()
