"""Samples that noise has carried past an end of the ambiguity range, brought back to where the others are.

A distance is an angle. Where it is near an end of its range, or its sample dark, noise makes it come out at
the other end, a whole range off, and methods that average distances take that for what it says. A sample
goes to the turn in which it is next to the circular mean of all frames there, if noise explains the rest;
what lies behind or before something else by more than noise stays where it is.
"""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_LIKELY = 5.0
"""Deviations from the mean that noise explains."""


def near_an_end(distance: Image, sigma: Image, ambiguity_range: float) -> NDArray[np.bool_]:
    """Which samples noise may have carried past an end of the range."""
    span = np.float32(ambiguity_range)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.minimum(distance, span - distance) < _LIKELY * sigma)


def circular_mean(
    distance: Image, amplitude: Image | None, positions: Image, ambiguity_range: float
) -> Image:
    """(H, W): the angle of the sum of all frames' phasors, as a distance; 0 where no sample falls.

    Args: distance, amplitude: (N, H, W); positions: (N, H, W, 2), where they look on the grid.
    """
    shape = distance.shape[1:]
    cell, inside = _cells(positions, shape)
    used = inside & np.isfinite(distance)
    phase = distance[used] * np.float32(2 * np.pi / ambiguity_range)
    weight = np.ones_like(phase) if amplitude is None else amplitude[used]
    count = shape[0] * shape[1]
    real = np.bincount(cell[used], weight * np.cos(phase), count)
    imaginary = np.bincount(cell[used], weight * np.sin(phase), count)
    angle = np.mod(np.arctan2(imaginary, real), 2 * np.pi) * (ambiguity_range / (2 * np.pi))
    return angle.astype(np.float32).reshape(shape)


def unwrap(distance: Image, sigma: Image, positions: Image, mean: Image, ambiguity_range: float) -> None:
    """Move samples (n, H, W), contiguous, in place; sigma: their deviations; mean: `circular_mean`."""
    span = np.float32(ambiguity_range)
    moved = np.flatnonzero(near_an_end(distance, sigma, ambiguity_range))
    cell, inside = _cells(positions.reshape(-1, 2)[moved], mean.shape)
    moved, cell = moved[inside], cell[inside]
    distance, sigma = distance.reshape(-1), sigma.reshape(-1)
    middle, own = mean.reshape(-1)[cell], distance[moved]
    near = own - span * np.rint((own - middle) / span)
    distance[moved] = np.where(np.abs(near - middle) <= _LIKELY * sigma[moved], near, own)


def _cells(positions: Image, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The number of the grid's pixel nearest to each position, and whether it is one."""
    with np.errstate(invalid="ignore"):
        row, column = (np.nan_to_num(np.rint(positions[..., k]), nan=-1).astype(np.int64) for k in (0, 1))
    inside = (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])
    return np.where(inside, row * shape[1] + column, 0), inside
