"""A built-in object to evaluate on: fine relief, thin parts, holes, and a sharp silhouette."""

import numpy as np
from numpy.typing import NDArray

DEPTH_RANGE = 182.0  # the paper's object spans 0..182 and its background lies at 182
BACKGROUND = (
    0.66  # in fractions of the side; near enough that one frame errs about as much as on the paper's object
)
SIDE = 400  # pixels of the paper's depth map; eight of them make one low-resolution pixel


def procedural_object(side: int = SIDE, oversampling: int = 2) -> NDArray[np.float32]:
    """Depth of a lantern on a foot, (side·oversampling)² float32, 0 (nearest) to 182 (background).

    A ribbed and dimpled body with a hooked handle, a ring through which the background shows, a comb of tines
    between a quarter of a low-resolution pixel and two, a fin, and a stepped foot.
    """
    count = side * oversampling
    axis = (np.arange(count) + 0.5) / count
    y, x = np.meshgrid(axis, axis, indexing="ij")
    depth = np.full((count, count), BACKGROUND)
    for part in (_body, _foot, _ring, _comb, _handle, _fin):
        depth = np.minimum(depth, part(x, y))
    depth -= depth.min()
    return np.asarray(depth / depth.max() * DEPTH_RANGE, np.float32)


Grid = NDArray[np.float64]


def _inside(mask: NDArray[np.bool_], depth: Grid) -> Grid:
    return np.where(mask, depth, np.inf)


def _body(x: Grid, y: Grid) -> Grid:
    u, v = (x - 0.42) / 0.24, (y - 0.56) / 0.27
    radius = u * u + v * v
    dome = 0.42 - 0.34 * np.sqrt(np.clip(1 - radius, 0, 1))
    angle = np.arctan2(v, u)
    ribs = 0.010 * np.cos(22 * angle) * np.clip(radius * 1.6 - 0.5, 0, 1)
    dimples = 0.012 * np.cos(2 * np.pi * x * 26) * np.cos(2 * np.pi * y * 26) * np.clip(0.6 - radius, 0, 1)
    groove = 0.02 * np.exp(-(((v - 0.25) / 0.02) ** 2))
    return _inside(radius < 1, dome + ribs + dimples + groove)


def _foot(x: Grid, y: Grid) -> Grid:
    step = np.floor((y - 0.80) / 0.032)
    half = 0.13 + 0.035 * step
    mask = (y > 0.80) & (y < 0.928) & (np.abs(x - 0.42) < half)
    bevel = 0.3 * np.abs(x - 0.42)
    return _inside(mask, 0.30 - 0.03 * step + bevel)


def _ring(x: Grid, y: Grid) -> Grid:
    distance = np.hypot(x - 0.80, y - 0.30)
    tube = 1 - ((distance - 0.115) / 0.028) ** 2
    twist = 0.008 * np.cos(9 * np.arctan2(y - 0.30, x - 0.80))
    return _inside(tube > 0, 0.36 - 0.06 * np.sqrt(np.clip(tube, 0, 1)) + twist)


def _comb(x: Grid, y: Grid) -> Grid:
    depth = np.full_like(x, np.inf)
    for number, width in enumerate((0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.04)):  # of 50 pixels: ¼ to 2
        centre = 0.565 + 0.058 * number
        lean = 0.06 * (y - 0.78)
        mask = (np.abs(x - centre - lean) < width / 2) & (y > 0.62) & (y < 0.90 - 0.012 * number)
        depth = np.minimum(depth, _inside(mask, 0.45 - 0.02 * number + 0.10 * (y - 0.62)))
    back = _inside((np.abs(y - 0.625) < 0.018) & (x > 0.545) & (x < 0.945), np.full_like(x, 0.40))
    return np.minimum(depth, back)


def _handle(x: Grid, y: Grid) -> Grid:
    distance = np.hypot((x - 0.36) / 1.25, y - 0.24)
    mask = (np.abs(distance - 0.11) < 0.011) & ((y < 0.30) | (x < 0.36))
    return _inside(mask, 0.28 + 0.25 * np.abs(y - 0.13))


def _fin(x: Grid, y: Grid) -> Grid:
    mask = (x > 0.05) & (x < 0.20) & (y > 0.30) & (y < 0.30 + 1.6 * (0.20 - x)) & (y < 0.52)
    waves = 0.015 * np.sin(2 * np.pi * (x + y) * 30)
    return _inside(mask, 0.45 + 0.8 * (0.20 - x) + waves)
