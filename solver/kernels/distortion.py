"""OpenCV's lens model without its tilt: distortion with its derivatives, and the inverse."""

import numba
import numpy as np


@numba.njit(cache=True, inline="always")
def distort(x, y, k):  # type: ignore[no-untyped-def]
    """Distorted position and its derivatives: (u, v, du/dx, du/dy, dv/dx, dv/dy), without the tilt.

    Args:
        x: (n,), to the right on the plane at distance 1, or one number.
        y: (n,), downward, or one number.
        k: (14,), OpenCV's coefficients.
    """
    r2 = x * x + y * y
    top = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    bottom = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    radial = top / bottom
    dtop = k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4])
    dbottom = k[5] + r2 * (2.0 * k[6] + 3.0 * r2 * k[7])
    slope = (dtop - radial * dbottom) / bottom  # d radial / d r²
    prism_x = k[8] + 2.0 * k[9] * r2
    prism_y = k[10] + 2.0 * k[11] * r2
    u = x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) + r2 * (k[8] + k[9] * r2)
    v = y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y + r2 * (k[10] + k[11] * r2)
    ux = radial + 2.0 * x * x * slope + 2.0 * k[2] * y + 6.0 * k[3] * x + 2.0 * x * prism_x
    uy = 2.0 * x * y * slope + 2.0 * k[2] * x + 2.0 * k[3] * y + 2.0 * y * prism_x
    vx = 2.0 * x * y * slope + 2.0 * k[2] * x + 2.0 * k[3] * y + 2.0 * x * prism_y
    vy = radial + 2.0 * y * y * slope + 6.0 * k[2] * y + 2.0 * k[3] * x + 2.0 * y * prism_y
    return u, v, ux, uy, vx, vy


@numba.njit(cache=True)
def undistort(image, k):  # type: ignore[no-untyped-def]
    """Undistorted (P, 2) of distorted positions (P, 2), by Newton's method; NaN where the model folds.

    Args:
        image: (P, 2), on the plane at distance 1.
        k: (14,), OpenCV's coefficients.
    """
    rays = np.full_like(image, np.nan)
    for i in range(len(image)):
        x, y = image[i]
        for _ in range(30):  # quadratic: a handful for a usable lens
            u, v, ux, uy, vx, vy = distort(x, y, k)
            du, dv = u - image[i, 0], v - image[i, 1]
            determinant = ux * vy - uy * vx
            if not determinant > 0.0:  # the model folds over: no unique ray
                break
            if abs(du) + abs(dv) < 1e-13:
                rays[i, 0] = x
                rays[i, 1] = y
                break
            x -= (vy * du - uy * dv) / determinant
            y -= (ux * dv - vx * du) / determinant
    return rays
