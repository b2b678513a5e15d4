"""Where each pixel looks, asked of the vendor's library, as intrinsics and lens distortion."""

import ctypes
from ctypes import c_void_p

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Intrinsics
from drivers.errors import OperationError
from drivers.mesasr.library import Library

NEAR, FAR = 16384, 49152
"""Counts, a quarter and three quarters of the range: two points on each ray, so that the origin, which need
not be the projection centre (10 mm before it in an SR4000), drops out."""

BAD_FIT = 0.1
"""Pixels; a residual beyond this says that the rays are not those of a lens with radial distortion."""


def pixel_rays(library: Library, handle: c_void_p, shape: tuple[int, int]) -> NDArray[np.float64]:
    """(rows, columns, 3) unit vectors in camera axes: x right, y down, z forward.

    The vendor's x points to the left of the image and y up.

    Raises:
        OperationError: the library refuses, or gives rays that do not look forward.
    """
    direction = _points(library, handle, shape, FAR) - _points(library, handle, shape, NEAR)
    direction[..., :2] *= -1
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    if not np.all(length > 0) or not np.all(direction[..., 2] > 0):
        raise OperationError("the vendor's library gives rays that do not look forward")
    rays: NDArray[np.float64] = direction / length
    return rays


def fit_lens(rays: NDArray[np.float64], nominal: Calibration | None, source: str) -> Calibration:
    """Intrinsics and two radial terms (OpenCV's k1, k2) that project the rays onto their pixels.

    Args:
        rays: (rows, columns, 3).
        nominal: what else is known of the model (noise law, footprint), or None.
        source: where the rays come from; the residual is added.
    """
    from scipy.optimize import least_squares

    rows, columns = rays.shape[:2]
    x, y = (rays[..., :2] / rays[..., 2:]).reshape(-1, 2).T
    v, u = np.mgrid[:rows, :columns].reshape(2, -1).astype(np.float64)
    squared = x**2 + y**2

    def residuals(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        fx, fy, cx, cy, k1, k2 = parameters
        radial = 1 + k1 * squared + k2 * squared**2
        return np.concatenate([fx * x * radial + cx - u, fy * y * radial + cy - v])

    focal = (columns - 1) / (x.max() - x.min())
    guess = [focal, focal, (columns - 1) / 2, (rows - 1) / 2, 0.0, 0.0]
    fitted = least_squares(residuals, guess, x_scale=[100, 100, 100, 100, 1, 1])
    fx, fy, cx, cy, k1, k2 = map(float, fitted.x)
    error = float(np.sqrt(np.mean(fitted.fun**2)))
    if error > BAD_FIT:
        raise OperationError(
            f"the rays of the vendor's library fit no lens with radial distortion ({error:.2f} px): measure "
            "the camera with `lidarboost calibrate intrinsics`"
        )
    known = {"noise": nominal.noise, "footprint": nominal.footprint} if nominal is not None else {}
    return Calibration(
        width=columns,
        height=rows,
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy),
        distortion=(k1, k2, 0.0, 0.0),
        source=f"{source}, residual {error:.3f} px",
        **known,
    )


def _points(library: Library, handle: c_void_p, shape: tuple[int, int], counts: int) -> NDArray[np.float64]:
    rows, columns = shape
    number = rows * columns
    row, column = np.mgrid[:rows, :columns].astype(np.uint8)
    distance = np.full(shape, counts, dtype=np.uint16)
    points = np.zeros((3, *shape), dtype=np.float32)
    status = library.call(
        "SR_CoordTrfPntFlt",
        handle,
        _pointer(column, ctypes.c_ubyte),
        _pointer(row, ctypes.c_ubyte),
        _pointer(distance, ctypes.c_ushort),
        *(_pointer(axis, ctypes.c_float) for axis in points),
        number,
    )
    if status < 0:
        raise OperationError(f"SR_CoordTrfPntFlt failed with {status}{library.explain()}")
    return np.moveaxis(points, 0, -1).astype(np.float64)


def _pointer(array: NDArray[np.generic], kind: type) -> "ctypes._Pointer":  # type: ignore[type-arg]
    return array.ctypes.data_as(ctypes.POINTER(kind))
