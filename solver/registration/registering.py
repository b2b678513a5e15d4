"""Where the frames look: the entrance to registration, and what it finds."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.geometry.points import rotations_to_shifts, shifts_to_rotations
from solver.registration.alignment import Alignment
from solver.registration.motion import Motion, Rotation, Shift
from solver.registration.placement import Placement
from solver.registration.samples import Source, pyramid, scaling

Float = NDArray[np.float64]

MODEL = 0.006  # pixels; RMS error on noise-free bursts, which the mosaic's limits leave


@dataclass(frozen=True, slots=True)
class Registration:
    """Where the frames look.

    Attributes:
        shifts: (N, 2) displacement (dy, dx) in low-resolution pixels of the reference, at the image centre.
        rotations: (N, 3) rotation vectors in radians that take each frame's rays to the reference's, or None
            where displacements were found.
        uncertainty: (N, 2) one standard deviation of the displacement at the image centre, in pixels.
        rejected: reason by frame number for the frames that do not fit; their shifts are no better than the
            first guess.
        period: pixels after which all that the frames show repeats, so that only a guess tells where one
            looks that is half of that away; None = it does not.
    """

    shifts: Float
    rotations: Float | None
    uncertainty: Float
    rejected: dict[int, str] = field(default_factory=dict)
    period: float | None = None


def register(
    distance: ArrayLike,
    amplitude: ArrayLike | None = None,
    *,
    intrinsics: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    reference: int = 0,
    ambiguity_range: float | None = None,
    source: Source = "auto",
) -> Registration:
    """Find where each frame looks, relative to the frame `reference`.

    A rotation per frame (three parameters) where the camera is calibrated, one displacement otherwise.

    Args:
        distance: (N, H, W), NaN = invalid.
        amplitude: (N, H, W), linear in the received light; weights the samples.
        intrinsics: 3 × 3, in low-resolution pixels.
        distortion: OpenCV coefficients.
        initial: (N, 2) displacements or, with intrinsics, (N, 3) rotation vectors: a first guess only.
        reference: number of the frame at rest.

    Raises:
        FusionInputError: wrong shapes, or NaN in `initial`.
        RegistrationError: the reference has hardly a valid pixel, no light or no contrast, or no other frame
            fits it.
    """
    images = np.asarray(distance, dtype=np.float32)
    light = None if amplitude is None else np.asarray(amplitude, dtype=np.float32)
    if images.ndim != 3 or (light is not None and light.shape != images.shape):
        raise FusionInputError(f"distance has shape {images.shape}; expected (N, H, W), amplitude the same")
    count, shape = len(images), (images.shape[1], images.shape[2])
    if not 0 <= reference < count:
        raise FusionInputError(f"reference is {reference}; expected a frame number from 0 to {count - 1}")
    motion: Motion = Shift() if intrinsics is None else Rotation.of(intrinsics, distortion)
    guess = _first_guess(initial, motion, count, shape)
    if count == 1:
        return _result(np.zeros((1, 3)), np.zeros((1, 3, 3)), {}, motion, shape, reference)
    levels = pyramid(scaling(images, light, ambiguity_range, source)(images, light))
    placed = Placement(levels, motion, reference, guess, guided=initial is not None)
    alignment = Alignment(placed)
    alignment.drop_empty()
    alignment.align()
    found = _result(placed.parameters, placed.covariance, placed.rejected, motion, shape, reference)
    return replace(found, period=alignment.period)


def _first_guess(initial: ArrayLike | None, motion: Motion, count: int, shape: tuple[int, int]) -> Float:
    guess = np.zeros((count, 3))
    if initial is None:
        return guess
    given: Float = np.asarray(initial, dtype=np.float64)
    if given.ndim != 2 or len(given) != count or given.shape[1] not in (2, 3):
        raise FusionInputError(f"initial has shape {given.shape}; expected ({count}, 2) or ({count}, 3)")
    if not np.isfinite(given).all():
        raise FusionInputError("initial holds NaN or infinity; expected finite numbers, or None")
    if isinstance(motion, Shift):
        if given.shape[1] == 3:
            raise FusionInputError("initial rotations (N, 3) need the camera's intrinsics")
        guess[:, :2] = given
    elif given.shape[1] == 3:
        guess[:] = given
    else:
        guess[:] = shifts_to_rotations(given, shape, motion.intrinsics, motion.lens)
    return guess


def _result(
    parameters: Float,
    covariance: Float,
    rejected: dict[int, str],
    motion: Motion,
    shape: tuple[int, int],
    reference: int,
) -> Registration:
    if isinstance(motion, Rotation):
        shifts = rotations_to_shifts(parameters, shape, motion.intrinsics, motion.lens)
        fy, fx = motion.camera(0)[:2]
        variance = np.stack([covariance[:, 0, 0] * fy**2, covariance[:, 1, 1] * fx**2], axis=-1)
    else:
        shifts = parameters[:, :2].copy()
        variance = np.stack([covariance[:, 0, 0], covariance[:, 1, 1]], axis=-1)
    # A frame's displacement is a difference: the reference's own error is part of it.
    uncertainty = np.sqrt(variance + variance[reference] + MODEL**2)
    uncertainty[reference] = 0
    rotations = parameters.copy() if isinstance(motion, Rotation) else None
    return Registration(shifts, rotations, uncertainty, rejected)
