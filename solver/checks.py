"""Refuses what cannot be fused, with what was given and what was expected."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.methods import METHODS
from solver.options import NEIGHBOURHOOD, FusionOptions


def check_options(options: FusionOptions) -> None:
    """Raise FusionInputError unless every option has a value that means something."""
    if options.method != "auto" and options.method not in METHODS:
        raise FusionInputError(
            f"method {options.method!r} is unknown; expected auto or one of {sorted(METHODS)}"
        )
    _check_integer("upsampling", options.upsampling)
    _check_integer("max_iterations", options.max_iterations)
    _check_number("tolerance", options.tolerance, above=0.0)
    if options.regularization != "auto":
        _check_number("regularization", options.regularization, above=0.0)
    if options.amplitude_threshold != "auto":
        _check_number("amplitude_threshold", options.amplitude_threshold, least=0.0)
    _check_number("fill", options.fill, least=0.0)
    _check_number("footprint.side", options.footprint.side, above=0.0)
    _check_number("footprint.blur", options.footprint.blur, least=0.0)
    offsets = set(options.neighbourhood)
    if not {(0, 1), (1, 0)} <= offsets <= set(NEIGHBOURHOOD):
        raise FusionInputError(
            f"neighbourhood is {options.neighbourhood!r}; "
            f"expected (0, 1), (1, 0) and any others of {NEIGHBOURHOOD}"
        )


def check_frames(distance: ArrayLike, name: str = "distance") -> NDArray[np.float32]:
    """The distances as float32 (N, H, W), NaN kept.

    Raises:
        FusionInputError: the shape is not (N, H, W) with at least one pixel, the type is not real, a value is
            infinite, or no pixel is valid.
    """
    frames = _floats(name, distance)
    if frames.ndim != 3:
        raise FusionInputError(f"{name} has shape {frames.shape}; expected (N, H, W), one image per frame")
    if frames.shape[0] == 0:
        raise FusionInputError(f"{name} holds no frame (shape {frames.shape}); expected at least one")
    if 0 in frames.shape:
        raise FusionInputError(f"{name} has images without pixels (shape {frames.shape})")
    if np.isinf(frames).any():
        raise FusionInputError(f"{name} holds infinite values; mark invalid pixels with NaN")
    if np.isnan(frames).all():
        raise FusionInputError(f"{name} has no valid pixel: every value is NaN")
    return frames


def check_amplitude(amplitude: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float32] | None:
    """The amplitudes as float32, shaped like the distances, none negative or infinite; NaN is not used."""
    if amplitude is None:
        return None
    values = _floats("amplitude", amplitude)
    if values.shape != shape:
        raise FusionInputError(f"amplitude has shape {values.shape}; expected that of distance, {shape}")
    if np.isinf(values).any():
        raise FusionInputError("amplitude holds infinite values; mark invalid pixels with NaN in distance")
    if (values < 0).any():
        raise FusionInputError(f"amplitude is negative (least {np.nanmin(values)}); expected 0 or more")
    return values


def check_vectors(
    name: str, values: ArrayLike | None, frames: int, widths: tuple[int, ...]
) -> NDArray[np.float64] | None:
    """Shifts, rotations or first guesses as float64 (N, 2 or 3), all finite."""
    if values is None:
        return None
    vectors = _floats(name, values, np.float64)
    if vectors.ndim != 2 or vectors.shape[0] != frames or vectors.shape[1] not in widths:
        expected = " or ".join(f"({frames}, {width})" for width in widths)
        raise FusionInputError(f"{name} has shape {vectors.shape}; expected {expected}, one row per frame")
    if not np.isfinite(vectors).all():
        raise FusionInputError(f"{name} holds NaN or infinite values; expected finite numbers")
    return vectors


def check_intrinsics(
    intrinsics: ArrayLike | None, distortion: ArrayLike | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """The camera matrix (3, 3) and OpenCV's distortion coefficients (4, 5, 8, 12 or 14), as float64."""
    lens = None
    if distortion is not None:
        lens = _floats("distortion", distortion, np.float64).ravel()
        if lens.size not in (4, 5, 8, 12, 14) or not np.isfinite(lens).all():
            raise FusionInputError(
                f"distortion has {lens.size} coefficients; expected 4, 5, 8, 12 or 14 finite ones"
            )
    if intrinsics is None:
        if lens is not None:
            raise FusionInputError("distortion is given without intrinsics; give the 3 × 3 camera matrix too")
        return None, None
    matrix = _floats("intrinsics", intrinsics, np.float64)
    if matrix.shape != (3, 3):
        raise FusionInputError(f"intrinsics has shape {matrix.shape}; expected a 3 × 3 matrix in pixels")
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise FusionInputError("intrinsics needs finite entries and positive focal lengths, in pixels")
    return matrix, lens


def check_scalar(name: str, value: float | None) -> float | None:
    """A positive finite number, or None."""
    if value is not None:
        _check_number(name, value, above=0.0)
        return float(value)
    return None


def check_guide(guide: ArrayLike | None, shape: tuple[int, int]) -> NDArray[np.float32] | None:
    """The guide image as float32 (βH, βW), all finite."""
    if guide is None:
        return None
    image = _floats("guide", guide)
    if image.shape != shape:
        raise FusionInputError(f"guide has shape {image.shape}; expected that of the fused map, {shape}")
    if not np.isfinite(image).all():
        raise FusionInputError("guide holds NaN or infinite values; expected a finite intensity image")
    return image


def _floats(name: str, values: ArrayLike, dtype: type[Any] = np.float32) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise FusionInputError(f"{name} is not an array: {error}") from error
    if array.dtype.kind not in "fiu":
        raise FusionInputError(f"{name} has type {array.dtype}; expected real numbers")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, dtype=dtype)


def _check_integer(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise FusionInputError(f"{name} is {value!r}; expected a whole number from 1 up")


def _check_number(
    name: str, value: object, *, above: float | None = None, least: float | None = None
) -> None:
    real = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    bounds = f"above {above}" if above is not None else f"from {least} up"
    if (
        not real
        or not math.isfinite(value)  # type: ignore[arg-type]
        or (above is not None and value <= above)  # type: ignore[operator]
        or (least is not None and value < least)  # type: ignore[operator]
    ):
        raise FusionInputError(f"{name} is {value!r}; expected a finite number {bounds}")
