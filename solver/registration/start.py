"""A first displacement of each frame, by search at the coarsest level."""

import numpy as np
from numpy.typing import NDArray

from solver.geometry.points import rotations_to_shifts, shifts_to_rotations
from solver.kernels.matching import search
from solver.registration.motion import Motion, Rotation
from solver.registration.samples import Samples

# Deviations at which a difference counts half, so that occlusion edges do not decide. Pooled weights are
# several times those of a pixel, and edges alias at this level.
LARGE = 32  # pixels of the shorter side from which a coarser search comes first
BETTER = 0.8  # times a guess's difference; within a coarse pixel aliasing changes it by up to a tenth


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
        found = search_shifts(coarse, reference, centre, (max(1, height // 4), max(1, width // 4)))
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
    if min(samples.shape) >= LARGE and max(radius) > 1:
        coarse = search_shifts(samples.pooled(), reference, centre, (radius[0] // 2, radius[1] // 2))
        return search_shifts(samples, reference, coarse, (1, 1))
    factor = 2**samples.level
    middle = np.rint(centre / factor).astype(np.int64)
    best = search(samples.values, samples.weights, reference, middle, radius[0], radius[1], better)
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
    found = search(values, samples.weights[chosen], 0, nowhere, radius[0], radius[1], 1.0)
    return np.asarray(found[1:], np.float64)
