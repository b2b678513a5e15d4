"""How far a fused map is from the truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Errors:
    """Over the pixels where both maps are known.

    Attributes:
        mse: mean squared error, the paper's measure.
        rmse: its root.
        mae: mean absolute error.
        coverage: share of the truth's pixels that the map covers.
    """

    mse: float
    rmse: float
    mae: float
    coverage: float


def errors(fused: Image, truth: Image) -> Errors:
    """Errors of a map against a truth of the same shape.

    Raises:
        FusionInputError: shapes differ, or nothing is known in both.
    """
    if fused.shape != truth.shape:
        raise FusionInputError(f"map has shape {fused.shape}; expected the truth's, {truth.shape}")
    have, want = fused.astype(np.float64), truth.astype(np.float64)
    known = np.isfinite(want)
    both = known & np.isfinite(have)
    if not both.any():
        raise FusionInputError("no pixel is known in both the map and the truth")
    difference = have[both] - want[both]
    mse = float(np.mean(difference**2))
    return Errors(mse, mse**0.5, float(np.mean(np.abs(difference))), float(both.sum() / known.sum()))


def percent_of_longest_side(fused: Image, truth: Image, pitch: float) -> Image:
    """|error| in percent of the object's longest side, as the paper colours it.

    The object is all that lies before the farthest depth; its sides are its extents in rows, columns and
    depth.

    Args:
        pitch: side of a fused pixel in the unit of depth.
    """
    body = np.isfinite(truth) & (truth < np.nanmax(truth))
    if not body.any():
        body = np.isfinite(truth)
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    extent = float(max(np.ptp(rows), np.ptp(columns)) + 1) * pitch
    longest = max(extent, float(np.ptp(truth[body])))
    return np.asarray(np.abs(fused - truth) * (100 / longest), np.float32)
