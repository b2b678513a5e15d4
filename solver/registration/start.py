"""A first displacement of each frame, by search at the coarsest level."""

import numpy as np
from numpy.typing import NDArray

from solver.geometry.points import rotations_to_shifts, shifts_to_rotations
from solver.kernels.matching import compare
from solver.registration.motion import Motion, Rotation
from solver.registration.samples import Samples

Image = NDArray[np.float32]
Whole = NDArray[np.int64]

LARGE = 32  # pixels of the shorter side from which a coarser search comes first
NEAR = 4  # pixels up to which it does not: it would go further than asked
FAR = 1e6  # pixels: beyond any image
REPEATS = 0.1  # of the cost one pixel aside: hard checks 0.015 and less, the least of other scenes 0.5
BETTER = 0.8  # times a guess's difference; within a coarse pixel aliasing changes it by up to a tenth


def find_start(
    coarse: Samples,
    shape: tuple[int, int],
    reference: int,
    guess: NDArray[np.float64],
    motion: Motion,
    guided: bool,
    period: float | None = None,
) -> NDArray[np.float64]:
    """Parameters (N, 3) of the motion: the guess, or where a frame agrees clearly better with the reference.

    Args:
        coarse: the coarsest level of the frames.
        shape: rows and columns at full resolution.
        guided: look next to the guess instead of up to a quarter of the image away.
        period: pixels after which the reference repeats: look no further than half of that away.
    """
    most = min(coarse.shape) if period is None else int(period / 2 / 2**coarse.level)
    radius = tuple(max(1, min(n // 4, most)) for n in coarse.shape)
    rotation = motion if isinstance(motion, Rotation) else None
    centre = (
        guess[:, :2]
        if rotation is None
        else rotations_to_shifts(guess, shape, rotation.intrinsics, rotation.lens)
    )
    if guided:
        found = search_shifts(coarse, reference, centre, (1, 1), BETTER)
    else:
        centre = np.zeros_like(centre)
        found = search_shifts(coarse, reference, centre, (radius[0], radius[1]))
    if rotation is None:
        return start_at(found, shape, motion)
    moved = (found != centre).any(axis=1)
    start = guess.copy()
    if not moved.any():
        return start
    start[moved] = start_at(found[moved], shape, rotation)
    return start


def start_at(shifts: NDArray[np.float64], shape: tuple[int, int], motion: Motion) -> NDArray[np.float64]:
    """Parameters (N, 3) of the motion for displacements (N, 2) in full-resolution pixels."""
    if isinstance(motion, Rotation):
        return shifts_to_rotations(shifts, shape, motion.intrinsics, motion.lens)
    return np.column_stack([shifts, np.zeros(len(shifts))])


def search_shifts(
    samples: Samples,
    reference: int,
    centre: NDArray[np.float64],
    radius: tuple[int, int],
    better: float = 1.0,
) -> NDArray[np.float64]:
    """Displacement (N, 2) of each frame from the reference, in full-resolution pixels.

    Tries every whole-pixel displacement of the level within `radius` of `centre` (N, 2, full-resolution
    pixels) and takes the least mean saturating difference over the overlap; of equals the one nearest to the
    centre. Another than the centre must have less than `better` times its difference.
    """
    if min(samples.shape) >= LARGE and max(radius) > NEAR:
        coarse = search_shifts(samples.pooled(), reference, centre, (radius[0] // 2, radius[1] // 2))
        return search_shifts(samples, reference, coarse, (1, 1))
    factor = 2**samples.level
    # A guess may look behind the camera, which is nowhere on an image.
    middle = np.rint(np.clip(np.nan_to_num(centre), -FAR, FAR) / factor).astype(np.int64)
    best = _least(samples.values, samples.weights, reference, middle, radius, better)
    moved = best != 0
    return np.where(moved, (middle + best) * factor, centre).astype(np.float64)


def seek_shifts(samples: Samples, reference: int, frames: list[int]) -> NDArray[np.float64]:
    """Displacements (frames, 2) from the reference, sought pixel by pixel up to a quarter of the image away.

    Slower by far than pooled images, in which what repeats in small looks alike.
    """
    chosen = [reference, *frames]
    values = np.ascontiguousarray(samples.values[:, chosen])
    height, width = samples.shape
    radius = max(1, height // 4), max(1, width // 4)
    nowhere = np.zeros((len(chosen), 2), np.int64)
    found = _least(values, samples.weights[chosen], 0, nowhere, radius, 1.0)
    return np.asarray(found[1:], np.float64)


def period(levels: list[Samples], reference: int) -> float | None:
    """The fewest pixels, over one, by which the reference may be displaced and look the same; None = by none.

    Looked for on the coarsest level, where a search would go astray; what has no whole period there shows a
    multiple of it, so that up to there it is looked for again at full resolution.
    """
    height, width = levels[-1].shape
    most = _repeat(levels[-1], reference, (max(1, height // 4), max(1, width // 4)))
    if most is None:
        return None
    radius = int(most * 2 ** levels[-1].level) + 1
    return _repeat(levels[0], reference, (radius, radius))


def _repeat(samples: Samples, reference: int, radius: tuple[int, int]) -> float | None:
    """The same within a radius, in pixels of this level; what is alike all the way there is no repetition."""
    chosen = np.ascontiguousarray(samples.values[:, [reference]]), samples.weights[[reference]]
    cost, away = _costs(*chosen, 0, np.zeros((1, 2), np.int64), radius)[0], _away(radius)
    beside = cost[away == 1].max()
    if not np.isfinite(beside):
        return None
    alike = cost < REPEATS * beside
    found = np.argwhere(alike & (away >= 2))
    half = np.array(radius) + np.trunc((found - radius) / 2).astype(int)
    found = found[~alike[half[:, 0], half[:, 1]]]
    return float(away[found[:, 0], found[:, 1]].min()) if len(found) else None


def _least(
    values: Image, weights: Image, reference: int, middle: Whole, radius: tuple[int, int], better: float
) -> Whole:
    """(N, 2): the displacement from the middle of the least cost; of equals the one nearest to it."""
    # A thousandth a pixel settles ties, as in a featureless scene.
    costs = _costs(values, weights, reference, middle, radius) + 0.001 * _away(radius)
    costs[:, radius[0], radius[1]] *= better
    least = costs.reshape(len(costs), -1).argmin(axis=1)
    found = np.stack(np.divmod(least, costs.shape[2]), axis=1) - radius
    found[~np.isfinite(costs).any(axis=(1, 2))] = 0
    found[reference] = 0
    return np.asarray(found, np.int64)


def _costs(
    values: Image, weights: Image, reference: int, middle: Whole, radius: tuple[int, int]
) -> NDArray[np.float64]:
    costs = np.empty((len(weights), 2 * radius[0] + 1, 2 * radius[1] + 1))
    compare(values, weights, reference, middle, costs)
    return costs


def _away(radius: tuple[int, int]) -> NDArray[np.float64]:
    """Pixels of each displacement from the middle one."""
    rows, columns = (np.arange(-r, r + 1) for r in radius)
    return np.hypot(rows[:, None], columns)
