"""What others would make of the same frames: `python tests/benchmarks/peers.py [--scene NAME] [--json FILE]`.

One table by recording: RMS and mean absolute error (mm) over every cell, the share of cells that the method
leaves unknown (they count as their nearest known neighbour), seconds, and peak memory beyond what was held.
All get the same rotations, those that `fuse` finds, and no frame that it rejects. Each peer is shown at the
settings, of those in `peer_methods.py`, whose RMS error against the truth is least: better than anybody could
choose who has no truth. Ours run with λ `auto`. A peer that is not installed is passed over.
Time and memory are the least of two runs after one to warm up. `results/peers.json` holds such a table. Needs
the extra `peers`, in an environment of its own: with it comes a plugin that pytest warns of.
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from fusion import peak_memory, reset_peak
from peer_methods import FACTOR, PEERS, Peer, Views
from regularization import RECORDINGS, Case, recorded
from scipy.ndimage import distance_transform_edt
from stored import store

from solver import FusionOptions, FusionWarning, fuse
from solver.evaluation import errors
from solver.options import Method

Image = np.ndarray
OURS: tuple[Method, ...] = ("nearest", "lidarboost", "area", "phasor")


@dataclass(frozen=True)
class Row:
    """One method on one recording; errors in mm, `unknown` a share, `peak` in bytes."""

    scene: str
    method: str
    settings: dict[str, Any]
    tried: int
    rms: float
    mean: float
    unknown: float
    seconds: float
    peak: int


def views_of(case: Case) -> Views:
    """The burst as peers take it."""
    given = case.given
    if given["distortion"] is not None:
        raise SystemExit(f"{case.scene}: its lens has distortion, which these libraries know nothing of")
    turns = np.stack([cv2.Rodrigues(vector)[0] for vector in np.asarray(given["rotations"], float)])
    return Views(given["distance"], turns, given["intrinsics"])


def judged(found: Image, truth: Image) -> tuple[float, float, float]:
    """RMS and mean absolute error in mm with unknown cells as their nearest known one, and their share."""
    unknown = ~np.isfinite(found)
    if unknown.all():
        return float("inf"), float("inf"), 1.0
    rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    error = errors(found[rows, columns], truth)
    return 1e3 * error.rmse, 1e3 * error.mae, float(unknown.mean())


def measured(
    scene: str, method: str, settings: dict[str, Any], tried: int, run: Callable[[], Image], truth: Image
) -> Row:
    """Judge a method, with its time and memory."""
    run()
    times, peaks = [], []
    for _ in range(2):
        held = reset_peak()
        began = time.perf_counter()
        found = run()
        times.append(time.perf_counter() - began)
        peaks.append(peak_memory() - held)
    rms, mean, unknown = judged(found, truth)
    return Row(scene, method, settings, tried, rms, mean, unknown, min(times), min(peaks))


def best(peer: Peer, views: Views, case: Case) -> Row:
    """A peer at the settings with the least RMS error."""
    choices = peer.choices()
    errs = [judged(peer.fuse(views, **choice), case.truth)[0] for choice in choices]
    choice = choices[int(np.argmin(errs))]
    run = partial(peer.fuse, views, **choice)
    return measured(case.scene, peer.name, choice, len(choices), run, case.truth)


def ours(method: Method, case: Case) -> Row:
    """One of ours as it comes."""
    options = FusionOptions(method=method, upsampling=FACTOR, **case.options)

    def run() -> Image:
        return fuse(options=options, **case.given).distance

    return measured(case.scene, method, {}, 1, run, case.truth)


def show(rows: list[Row]) -> None:
    """The table as text."""
    print("scene     method            RMS mm   mean mm  unknown  seconds  memory MB  settings (of how many)")
    for row in rows:
        chosen = ", ".join(f"{name} {value}" for name, value in row.settings.items()) or "auto"
        print(
            f"{row.scene:<9} {row.method:<15} {row.rms:>8.1f} {row.mean:>9.1f} {row.unknown:>7.1%} "
            f"{row.seconds:>8.2f} {row.peak / 2**20:>10.0f}  {chosen} ({row.tried})"
        )


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", choices=RECORDINGS, help="only this; repeatable")
    parser.add_argument("--json", type=Path, help="save everything here as well")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore", FusionWarning)
    warnings.filterwarnings("ignore", "All-NaN slice|Mean of empty slice", RuntimeWarning)
    rows = []
    for scene in chosen.scene or RECORDINGS:
        case = next(recorded(scene, 1))
        views = views_of(case)
        for peer in PEERS:
            if peer.missing is None:
                rows.append(best(peer, views, case))
            elif scene == (chosen.scene or RECORDINGS)[0]:
                print(f"{peer.name} is not installed: {peer.missing}", file=sys.stderr)
        rows += [ours(method, case) for method in OURS]
    show(rows)
    if chosen.json:
        store(chosen.json, rows=[asdict(row) for row in rows])


if __name__ == "__main__":
    main()
