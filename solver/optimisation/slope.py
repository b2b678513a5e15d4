"""Where a map is heading: the slope that the prior lets pass.

A first-order prior charges a ramp as much as the step that climbs as high, so ramps become stairs.
Subtracting the slope of the surroundings makes ramps free: total generalised variation (Bredies, Kunisch,
Pock, "Total generalized variation", SIAM J. Imaging Sci. 2010) with its vector field fixed within a pass.
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import agreement
from solver.kernels import rises as kernels
from solver.kernels.smoothing import gaussian
from solver.runtime import team

_REACH = 5.0
"""Deviation of the Gaussian that averages slopes, fused pixels: over one low-resolution pixel at ×4.
It is applied at half the resolution, which so wide a Gaussian does not need."""

_TAPS = 3.6
"""Deviations to either side, at least."""

_AWAY = 1.5
"""How far to the side the windows are whose slopes a pixel may take, in units of the reach."""


def slope(
    x: NDArray[np.floating],
    edge: float,
    reach: float = _REACH,
    *,
    before: NDArray[np.floating] | None = None,
    measure: NDArray[np.floating] | None = None,
    weight: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """The rise per row and per column of a padded map, averaged over its surroundings.

    Args:
        x: (C, rows + 4, columns + 4), padded.
        edge: how far from the slope before a gradient is that of an edge, which has no slope; such pixels
            take their neighbours'.
        reach: deviation of the Gaussian that averages slopes, fused pixels.
        before: a slope found before; None = level.
        measure: (rows + 4, columns + 4), what slopes are averaged in the unit of; None = 1.
        weight: (rows + 4, columns + 4), of each pixel's say; None = 1.

    Returns:
        (C, 2, rows + 4, columns + 4), in the measure per pixel, zero in the padding.
    """
    channels, rows, columns = len(x), x.shape[1] - 4, x.shape[2] - 4
    before = np.zeros((channels, 2, *x.shape[1:]), x.dtype) if before is None else before
    measure = np.ones(x.shape[1:], x.dtype) if measure is None else measure
    weight = np.ones(x.shape[1:], x.dtype) if weight is None else weight
    taps = gaussian(reach / 2, int(np.ceil(_TAPS * reach / 2))).astype(x.dtype)
    votes = np.empty((1 + 2 * channels, (rows + 1) // 2, (columns + 1) // 2), x.dtype)
    team.share(kernels.votes, x, before, measure, weight, x.dtype.type(1 / edge**2), taps, votes)
    out: NDArray[np.floating] = np.empty((channels, 2, *x.shape[1:]), x.dtype)
    team.share(kernels.slopes, votes, taps, x.dtype.type(np.finfo(np.float32).tiny), out)
    return out


def agreed(
    x: NDArray[np.floating],
    slopes: NDArray[np.floating],
    edge: float,
    reach: float,
    measure: NDArray[np.floating],
    light: NDArray[np.floating],
    noise: float,
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Slopes of the windows that each pixel agrees with: beside a fold those of its own side.

    A window about a pixel reaches over a fold, where two surfaces meet, and foretells a slope that neither
    has. One that lies to the side does not (Nagao, Matsuyama, "Edge preserving smoothing", CGIP 1979).

    Where nothing folds, a mean over a window of deviation r errs by ½ r² times the second derivatives of the
    slope, which the windows to the sides, a away, tell: that error is taken off. As their second differences
    hold noise too, only the part of their power that exceeds it is (as in Wiener's filter).

    Args:
        x: (1, rows + 4, columns + 4), padded.
        slopes: (1, 2, rows + 4, columns + 4), of windows about each pixel, as `slope` gives them.
        edge: how far from a window's slope a gradient is hardly of its surface.
        reach: r, fused pixels.
        measure: as in `slope`.
        light: (rows + 4, columns + 4), about each pixel.
        noise: variance of a fused pixel's data at light 1, in x's unit²; it falls with the light.

    Returns:
        (1, 2, rows + 4, columns + 4), slopes in x's unit per pixel; (rows, columns), the squared second
        differences of `slopes` between the windows, in x's unit per pixel: noise and relief.
    """
    rows, columns = x.shape[1] - 4, x.shape[2] - 4
    out, bent, away = np.empty_like(slopes), np.empty((rows, columns), x.dtype), apart(reach)
    share = x.dtype.type(0.5 * (reach / away) ** 2)
    law = away, x.dtype.type(1 / edge**2), share
    image = x[0], slopes[0], measure, light
    team.share(agreement.choose, *image, x.dtype.type(curvature_noise(reach) * noise), *law, out[0], bent)
    return out, bent


def apart(reach: float) -> int:
    """Fused pixels to the windows at the sides, at least one."""
    return max(1, round(_AWAY * reach))


def curvature_noise(reach: float) -> float:
    """Sum of the variances of second differences of slopes, of white noise of variance 1 a fused pixel.

    Of both components along both axes. Each slope, averaged by a Gaussian of deviation r, has 1 / (8π r⁴);
    those of windows a r apart correlate by exp(−a² / 4) across the way between them, by (1 − a² / 2) times
    that along it.
    """
    a = apart(reach) / reach
    near, far = (float(np.exp(-(b**2) / 4)) for b in (a, 2 * a))
    along = 6 - 8 * near * (1 - a**2 / 2) + 2 * far * (1 - 2 * a**2)
    return 2 * (along + 6 - 8 * near + 2 * far) / (8 * np.pi * reach**4)
