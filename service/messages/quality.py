"""How far a fused map is from the truth, where there is one, beside what a single frame would give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.fusion.fuse import FusedBurst


@dataclass(frozen=True, slots=True)
class Quality:
    """Errors of the distance in metres, over the pixels that truth, map and single frame all know.

    Attributes:
        rms, mean_absolute: of the fused map.
        nearest_rms, nearest_mean_absolute: of the reference frame, each pixel repeated β × β times.
        pixels: how many were compared.
    """

    rms: float
    mean_absolute: float
    nearest_rms: float
    nearest_mean_absolute: float
    pixels: int


def error_map(result: FusedBurst, truth: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """(βH, βW) fused minus true distance, metres; None without a truth of the map's size."""
    if truth is None or truth.shape != result.distance.shape:
        return None
    return result.distance - truth


def judge(result: FusedBurst, truth: NDArray[np.float32] | None) -> Quality | None:
    """Compare a map with the truth (βH, βW), metres; None without a truth of the map's size."""
    error = error_map(result, truth)
    if error is None or truth is None:
        return None
    frame = result.calibration.correct(result.frame.distance, result.frame.ambiguity_range)
    factor = result.report.upsampling
    single = frame.repeat(factor, axis=0).repeat(factor, axis=1) - truth
    both = np.isfinite(error) & np.isfinite(single)
    if not both.any():
        return None
    ours, theirs = error[both].astype(np.float64), single[both].astype(np.float64)
    return Quality(
        rms=float(np.sqrt(np.mean(ours**2))),
        mean_absolute=float(np.mean(np.abs(ours))),
        nearest_rms=float(np.sqrt(np.mean(theirs**2))),
        nearest_mean_absolute=float(np.mean(np.abs(theirs))),
        pixels=int(both.sum()),
    )
