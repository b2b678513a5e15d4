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


def errors(fused: Image, truth: Image, region: tuple[slice, slice] | None = None) -> Errors:
    """Errors of a map against a truth of the same shape, inside a region of interest.

    Raises:
        FusionInputError: shapes differ, or nothing is known in the region.
    """
    if fused.shape != truth.shape:
        raise FusionInputError(f"map has shape {fused.shape}; expected the truth's, {truth.shape}")
    window = region or (slice(None), slice(None))
    have, want = fused[window].astype(np.float64), truth[window].astype(np.float64)
    known = np.isfinite(want)
    both = known & np.isfinite(have)
    if not both.any():
        raise FusionInputError("no pixel of the region is known in both the map and the truth")
    difference = have[both] - want[both]
    mse = float(np.mean(difference**2))
    return Errors(mse, mse**0.5, float(np.mean(np.abs(difference))), float(both.sum() / known.sum()))


def percent_of_longest_side(fused: Image, truth: Image, background: float | None = None) -> Image:
    """|error| in percent of the object's longest side, as the paper colours it.

    The longest side is the largest extent of the object in rows, columns (in fused pixels) or depth (in the
    map's unit): the largest of the three numbers, with the object being all that lies before `background`.
    """
    limit = float(np.nanmax(truth)) if background is None else background
    body = np.isfinite(truth) & (truth < limit)
    if not body.any():
        body = np.isfinite(truth)
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    depth = float(np.ptp(truth[body]))
    longest = max(float(np.ptp(rows)) + 1, float(np.ptp(columns)) + 1, depth)
    return np.asarray(np.abs(fused - truth) * (100 / longest), np.float32)
