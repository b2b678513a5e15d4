"""The map that frames are registered against: all of them, fused on a grid somewhat finer than a pixel.

Each frame is a set of point samples of one continuous image, the scene blurred by the pixel's footprint. That
image is written as U, bilinear on a grid of about two nodes per pixel, and found from all samples by

    min_U  Σ_s w_s (y_s − U(p_s))²  +  λ Σ √(|∇U|² + ε²),        w = 1 / σ²

with the second term reweighted (lagged diffusivity). Every sample touches 2 × 2 nodes, so the normal
operator is a nine-point stencil, kept as five coefficient images. The footprint stays inside U: nothing is
deconvolved, and the aliasing of the single frames cancels. The edge-preserving prior matters: with a
quadratic one the noise that stays in U pulls the frames towards each other's noise.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.stencil import conjugate_gradients

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

UNSEEN, FLAT, STEEP = 0, 1, 2
COLD = 4  # reweightings from a blurred start; one is enough from an earlier mosaic
STEEPEST = 0.18  # share of the mosaic that counts as steep: its edges
EPSILON = 0.3  # of a deviation between nodes: where the prior turns from quadratic to absolute


@dataclass(frozen=True, slots=True)
class Grid:
    """Nodes: `density` per pixel, the first one at `origin` (row, column) in pixels of the reference.

    A whole number of nodes per pixel would put all pixels of the reference, and of every shifted frame, at
    the same place between nodes, where the interpolation error has the same sign; a fraction lets it average
    out.
    """

    origin: tuple[float, float]
    size: tuple[int, int]
    density: float

    @classmethod
    def over(cls, positions: Image, density: float) -> "Grid":
        """The grid that holds positions (N, H, W, 2), but at most one image beyond the reference."""
        shape = np.array(positions.shape[1:3])
        border = np.concatenate(
            [
                positions[:, [0, -1]].reshape(-1, 2),
                positions[:, :, [0, -1]].reshape(-1, 2),
            ]
        )
        low = np.maximum(np.floor(np.nanmin(border, axis=0)), -shape) - 1
        high = np.minimum(np.ceil(np.nanmax(border, axis=0)), 2 * shape) + 1
        rows, columns = np.ceil((high - low) * density).astype(int) + 1
        return cls((float(low[0]), float(low[1])), (int(rows), int(columns)), density)


@dataclass(frozen=True, slots=True)
class Mosaic:
    """U (C, rows, columns), its slopes per pixel with their noise's variance, and each node's kind.

    The kinds are `UNSEEN`, `FLAT` and `STEEP`.
    """

    values: Image
    down: Image
    right: Image
    kind: NDArray[np.uint8]
    grid: Grid
    slope_noise: float


def build_mosaic(
    values: Image,
    weights: Image,
    positions: Image,
    grid: Grid,
    *,
    smoothing: float,
    sweeps: int,
    start: Image | None = None,
) -> Mosaic:
    """U from samples (C, N, H, W), weights 1/σ² (N, H, W) of typically one, at positions (N, H, W, 2).

    Args:
        smoothing: λ in units of 1/σ, σ the typical deviation of a sample.
        sweeps: conjugate-gradient steps per reweighting.
        start: a first U on the same grid.
    """
    # One layout for all callers: each further one is compiled for several seconds on a new machine.
    values = np.ascontiguousarray(values)
    stencil, right = _accumulate(values, weights, positions, *grid.origin, grid.density, *grid.size)
    image = _weighted_mean(stencil, right) if start is None else start
    for _ in range(COLD if start is None else 1):
        stiff = _stiffened(stencil, image, smoothing, EPSILON / grid.density)
        image, _ = conjugate_gradients(stiff, right, image, steps=sweeps)
    down, across = np.empty_like(image), np.empty_like(image)
    square = _slopes(image, grid.density, down, across)
    mass = cv2.blur(stencil[0], (3, 3))
    seen = mass[::3, ::3]
    covered = mass > (0.1 * float(np.median(seen[seen > 0])) if seen.any() else 0)
    mass_per_node = float(stencil[0].sum() + 2 * stencil[1:].sum()) / max(int(covered.sum()), 1)
    # That of central differences of independent nodes: the prior lowers it, picking steep nodes raises it.
    noise = len(image) * grid.density**2 / (2 * mass_per_node + 1e-30)
    return Mosaic(image, down, across, _kinds(square, covered), grid, noise)


def _kinds(square: Image, covered: Mask) -> NDArray[np.uint8]:
    """Nodes seen, and those within two nodes of the steepest part of the mosaic."""
    kind = np.where(covered, FLAT, UNSEEN).astype(np.uint8)
    some = square[::3, ::3][covered[::3, ::3]]  # a ninth of the nodes tells the quantile
    if some.size:
        limit = float(np.quantile(some, 1 - STEEPEST))
        near = cv2.dilate((covered & (square >= limit)).astype(np.uint8), np.ones((5, 5), np.uint8))
        kind[covered & (near > 0)] = STEEP
    return kind


def resampled(mosaic: Mosaic, grid: Grid, factor: float) -> Image:
    """A mosaic's U at the nodes of a grid whose pixels are `factor` of the mosaic's, edges repeated."""
    scale = mosaic.grid.density * factor / grid.density
    offset = [
        ((place + 0.5) * factor - 0.5 - start) * mosaic.grid.density
        for place, start in zip(grid.origin, mosaic.grid.origin, strict=True)
    ]
    matrix = np.array([[scale, 0, offset[1]], [0, scale, offset[0]]])
    size = (grid.size[1], grid.size[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.stack(
        [
            cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            for image in mosaic.values
        ]
    ).astype(np.float32, copy=False)


def steep_samples(mosaic: Mosaic, positions: Image) -> Mask:
    """Samples (N, H, W) that lie where the mosaic is steep: elsewhere a displacement changes little."""
    found: Mask = _lookup(mosaic.kind, positions, *mosaic.grid.origin, mosaic.grid.density)
    return found


@numba.njit(cache=True, parallel=True)
def _lookup(image, positions, row0, column0, density):  # type: ignore[no-untyped-def]
    count, height, width = positions.shape[:3]
    rows, columns = image.shape
    found = np.zeros((count, height, width), dtype=np.bool_)
    for item in numba.prange(count * height):
        k, i = item // height, item % height
        for j in range(width):
            r = (positions[k, i, j, 0] - row0) * density + 0.5
            c = (positions[k, i, j, 1] - column0) * density + 0.5
            if r >= 0.0 and c >= 0.0 and r < rows and c < columns:
                found[k, i, j] = image[int(r), int(c)] == STEEP
    return found


def _weighted_mean(stencil: Image, right: Image) -> Image:
    """A first U: the weighted mean of the samples around each node, of farther ones where there are none."""
    top: Image = right
    bottom: Image = stencil[0] + stencil[1] + stencil[2]
    enough = 1e-3 * float(bottom.mean())
    result = np.zeros_like(right)
    known = np.zeros(bottom.shape, dtype=bool)
    for _ in range(4):
        top = np.stack([cv2.GaussianBlur(channel, (0, 0), 1.5) for channel in top])
        bottom = np.asarray(cv2.GaussianBlur(bottom, (0, 0), 1.5), np.float32)
        fresh = ~known & (bottom > enough)
        np.divide(top, bottom, out=result, where=fresh)
        known |= fresh
        if known.all():
            return result
    result[:, ~known] = result[:, known].mean(axis=1, keepdims=True) if known.any() else 0
    return result


@numba.njit(cache=True, parallel=True, fastmath=True)
def _accumulate(values, weights, positions, row0, column0, density, rows, columns):  # type: ignore[no-untyped-def]
    channels, count, height, width = values.shape
    parts = 2  # fixed, so that the sums do not depend on the number of threads
    stencil = np.zeros((parts, 5, rows, columns), dtype=np.float32)
    right = np.zeros((parts, channels, rows, columns), dtype=np.float32)
    top, left, scale, one = np.float32(row0), np.float32(column0), np.float32(density), np.float32(1.0)
    for part in numba.prange(parts):
        S, b = stencil[part], right[part]
        for k in range(part, count, parts):
            for i in range(height):
                for j in range(width):
                    w = weights[k, i, j]
                    if w <= 0.0:
                        continue
                    r = (positions[k, i, j, 0] - top) * scale
                    c = (positions[k, i, j, 1] - left) * scale
                    if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
                        continue
                    m, n = int(r), int(c)
                    a, d = r - np.float32(m), c - np.float32(n)
                    w00, w01 = (one - a) * (one - d), (one - a) * d
                    w10, w11 = a * (one - d), a * d
                    for h in range(channels):
                        y = w * values[h, k, i, j]
                        b[h, m, n] += w00 * y
                        b[h, m, n + 1] += w01 * y
                        b[h, m + 1, n] += w10 * y
                        b[h, m + 1, n + 1] += w11 * y
                    S[0, m, n] += w * w00 * w00
                    S[0, m, n + 1] += w * w01 * w01
                    S[0, m + 1, n] += w * w10 * w10
                    S[0, m + 1, n + 1] += w * w11 * w11
                    S[1, m, n] += w * w00 * w01  # to the right
                    S[1, m + 1, n] += w * w10 * w11
                    S[2, m, n] += w * w00 * w10  # down
                    S[2, m, n + 1] += w * w01 * w11
                    S[3, m, n] += w * w00 * w11  # down and right
                    S[4, m, n + 1] += w * w01 * w10  # down and left
    return stencil[0] + stencil[1], right[0] + right[1]


@numba.njit(cache=True, fastmath=True)
def _stiffened(stencil, image, strength, epsilon):  # type: ignore[no-untyped-def]
    """The stencil plus the prior's, reweighted at the image: stiffness λ / √(|∇U|² + ε²), a mean of 3 × 3."""
    channels, rows, columns = image.shape
    size = np.zeros((rows, columns), dtype=np.float32)
    for i in range(rows - 1):
        for j in range(columns - 1):
            square = np.float32(0.0)
            for h in range(channels):
                down = image[h, i + 1, j] - image[h, i, j]
                right = image[h, i, j + 1] - image[h, i, j]
                square += down * down + right * right
            size[i, j] = square
    stiffness = np.empty((rows, columns), dtype=np.float32)
    lam, floor = np.float32(strength), np.float32(epsilon * epsilon)
    for i in range(rows):
        up, low = max(i - 1, 0), min(i + 1, rows - 1)
        for j in range(columns):
            before, after = max(j - 1, 0), min(j + 1, columns - 1)
            total = size[i, j] + size[i, before] + size[i, after]
            total += size[up, j] + size[up, before] + size[up, after]
            total += size[low, j] + size[low, before] + size[low, after]
            stiffness[i, j] = lam / np.sqrt(total / np.float32(9.0) + floor)
    result = stencil.copy()
    half = np.float32(0.5)
    for i in range(rows):
        for j in range(columns):
            own = stiffness[i, j]
            if j + 1 < columns:
                across = half * (own + stiffness[i, j + 1])
                result[1, i, j] -= across
                result[0, i, j] += across
            if j > 0:
                result[0, i, j] += half * (own + stiffness[i, j - 1])
            if i + 1 < rows:
                along = half * (own + stiffness[i + 1, j])
                result[2, i, j] -= along
                result[0, i, j] += along
            if i > 0:
                result[0, i, j] += half * (own + stiffness[i - 1, j])
    return result


@numba.njit(cache=True, fastmath=True)
def _slopes(image, density, down, across):  # type: ignore[no-untyped-def]
    """Central differences per pixel into `down` and `across`; returns |∇U|² (rows, columns)."""
    channels, rows, columns = image.shape
    square = np.zeros((rows, columns), dtype=np.float32)
    half = np.float32(0.5 * density)
    for i in range(rows):
        up, low = max(i - 1, 0), min(i + 1, rows - 1)
        for h in range(channels):
            above, below, x = image[h, up], image[h, low], image[h, i]
            before, after, middle = x[:-2], x[2:], across[h, i, 1:-1]
            for j in range(columns):
                down[h, i, j] = half * (below[j] - above[j])
            for j in range(columns - 2):
                middle[j] = half * (after[j] - before[j])
            across[h, i, 0] = across[h, i, columns - 1] = np.float32(0.0)
            for j in range(columns):
                square[i, j] += down[h, i, j] * down[h, i, j] + across[h, i, j] * across[h, i, j]
    return square
