"""A first displacement of each frame, by search at the coarsest level."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.geometry.points import rotations_to_shifts, shifts_to_rotations
from solver.registration.motion import Motion, Turn
from solver.registration.samples import Samples

# Deviations at which a difference counts half, so that occlusion edges do not decide. Pooled weights are
# several times those of a pixel, and edges alias at this level.
HALF = 30.0
LARGE = 32  # pixels of the shorter side from which a coarser search comes first
UNUSED = np.float32(1e32)
BETTER = 0.8  # times a guess's difference; within a coarse pixel aliasing changes it by up to a tenth
LEAST_OVERLAP = 0.4  # of the frame's used pixels


def find_start(
    coarse: Samples,
    shape: tuple[int, int],
    reference: int,
    guess: NDArray[np.float64],
    motion: Motion,
    guided: bool,
) -> NDArray[np.float64]:
    """Parameters (N, 3) of the motion: the guess, or where a frame agrees clearly better with the reference.

    Args:
        coarse: the coarsest level of the frames.
        shape: rows and columns at full resolution.
        guided: look next to the guess instead of up to a quarter of the image away.
    """
    height, width = coarse.shape
    turn = motion if isinstance(motion, Turn) else None
    centre = guess[:, :2] if turn is None else rotations_to_shifts(guess, shape, turn.intrinsics, turn.lens)
    if guided:
        found = search_shifts(coarse, reference, centre, (1, 1), BETTER)
    else:
        centre = np.zeros_like(centre)
        found = search_shifts(coarse, reference, centre, (max(1, height // 4), max(1, width // 4)))
    if turn is None:
        return start_at(found, shape, motion)
    moved = (found != centre).any(axis=1)
    start = guess.copy()
    if not moved.any():
        return start
    start[moved] = start_at(found[moved], shape, turn)
    return start


def start_at(shifts: NDArray[np.float64], shape: tuple[int, int], motion: Motion) -> NDArray[np.float64]:
    """Parameters (N, 3) of the motion for displacements (N, 2) in full-resolution pixels."""
    if isinstance(motion, Turn):
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
    if min(samples.shape) >= LARGE and max(radius) > 1:
        coarse = search_shifts(samples.pooled(), reference, centre, (radius[0] // 2, radius[1] // 2))
        return search_shifts(samples, reference, coarse, (1, 1))
    factor = 2**samples.level
    middle = np.rint(centre / factor).astype(np.int64)
    best = _search(samples.values, samples.weights, reference, middle, radius[0], radius[1], better)
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
    found = _search(values, samples.weights[chosen], 0, nowhere, radius[0], radius[1], 1.0)
    return np.asarray(found[1:], np.float64)


@numba.njit(cache=True)
def _search(values, weights, reference, middle, rows, columns, better):  # type: ignore[no-untyped-def]
    count, height = weights.shape[:2]
    found = np.zeros((count, 2), dtype=np.int64)
    stride = 1 if height < 32 else 2  # every second row is plenty
    # w v / (w + v) = 1 / (1/w + 1/v); a pixel that is not used has a huge variance.
    variance = np.empty_like(weights)
    used = np.zeros(count, np.int64)
    for k in range(count):
        for i in range(height):
            for j in range(weights.shape[2]):
                weight = weights[k, i, j]
                variance[k, i, j] = (
                    np.float32(1.0) / max(weight, np.float32(1e-32)) if weight > 0.0 else UNUSED
                )
                used[k] += weight > 0.0 and i % stride == 0
    buffer = np.empty(weights.shape[2], dtype=np.float32)
    for k in range(count):
        if k == reference:
            continue
        lowest = np.inf
        for a in range(-rows, rows + 1):
            for b in range(-columns, columns + 1):
                dy, dx = middle[k, 0] + a, middle[k, 1] + b
                cost, seen = _compare(values, variance, k, reference, dy, dx, stride, buffer)
                if seen < LEAST_OVERLAP * used[k] or seen == 0:
                    continue
                # A thousandth a pixel settles ties, as in a featureless scene.
                mean = cost / seen + 0.001 * np.sqrt(float(a * a + b * b))
                if a == 0 and b == 0:
                    mean *= better
                if mean < lowest:
                    lowest = mean
                    found[k, 0], found[k, 1] = a, b
    return found


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _compare(values, variance, k, reference, dy, dx, stride, buffer):  # type: ignore[no-untyped-def]
    """Sum of the saturating differences at a displacement, and how many pixels overlap."""
    channels, _, height, width = values.shape
    begin, end = max(0, -dx), min(width, width - dx)
    knee, most = np.float32(HALF * HALF), np.float32(0.5 * UNUSED)
    cost, seen = np.float32(0.0), np.float32(0.0)
    if begin >= end:
        return cost, seen
    square = buffer[: end - begin]
    for i in range(max(0, -dy), min(height, height - dy), stride):
        square[:] = np.float32(0.0)
        for h in range(channels):
            x, y = values[h, k, i, begin:end], values[h, reference, i + dy, begin + dx : end + dx]
            for j in range(len(square)):
                change = x[j] - y[j]
                square[j] += change * change
        used, other = variance[k, i, begin:end], variance[reference, i + dy, begin + dx : end + dx]
        for j in range(len(square)):
            both = used[j] + other[j]
            known = np.float32(both < most)
            # s / (s + knee) with s = square / both
            cost += known * square[j] / (square[j] + knee * both)
            seen += known
    return cost, seen
