"""The map that frames are registered against: all of them, fused on a grid somewhat finer than a pixel.

Each frame is a set of point samples of one continuous image, the scene blurred by the pixel's footprint. That
image is written as U, bilinear on a grid of a few nodes per pixel, and found from all samples by

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

Image = NDArray[np.float32]


@dataclass(slots=True)
class Mosaic:
    """U, how much data each node saw, and the place of the first node in pixels of the reference."""

    values: Image
    support: Image
    origin: tuple[float, float]
    grid: float


def build_mosaic(
    values: Image,
    weights: Image,
    positions: Image,
    *,
    grid: float,
    smoothing: float,
    start: Mosaic | None,
    sweeps: int,
) -> Mosaic:
    """U (C, rows, columns) from samples (C, N, H, W), weights 1/σ² (N, H, W), at positions (N, H, W, 2).

    Args:
        grid: nodes per pixel.
        smoothing: λ in units of 1/σ, σ the typical deviation of a sample.
        start: an earlier mosaic to start from, used where its grid is the same.
        sweeps: conjugate-gradient steps per reweighting.
    """
    origin, size = _grid(positions, weights, grid)
    grid = float(grid)
    stencil, right = _accumulate(values, weights, positions, origin[0], origin[1], grid, size[0], size[1])
    known = weights > 0
    scale = float(np.sqrt(weights[known].mean())) if known.any() else 1.0  # 1/σ of a typical sample
    if start is not None and start.values.shape[1:] == size and start.origin == origin:
        image, passes = start.values, 1
    else:
        image, passes = _weighted_mean(stencil, right), 2
    for _ in range(passes):
        stiff = _stiffened(stencil, image, smoothing * scale, 0.3 / (scale * grid))
        image = _conjugate_gradients(stiff, right, image, sweeps)
    return Mosaic(image, stencil[0], origin, grid)


def _grid(positions: Image, weights: Image, grid: float) -> tuple[tuple[float, float], tuple[int, int]]:
    """Origin and size of the grid that holds all used samples, with a pixel to spare."""
    used = positions[weights > 0]
    low = np.floor(used.min(axis=0).astype(np.float64)) - 1
    high = np.ceil(used.max(axis=0).astype(np.float64)) + 1
    rows, columns = ((high - low) * grid + 1).astype(int)
    return (float(low[0]), float(low[1])), (int(rows), int(columns))


def _weighted_mean(stencil: Image, right: Image) -> Image:
    """A first U: the weighted mean of the samples around each node, of farther ones where there are none."""
    top: Image = right
    bottom: Image = stencil[0] + stencil[1] + stencil[2]
    enough = 1e-3 * float(bottom.mean())
    result = np.zeros_like(right)
    known = np.zeros(bottom.shape, dtype=bool)
    for _ in range(5):
        top = np.stack([cv2.GaussianBlur(channel, (0, 0), 1.5) for channel in top])
        bottom = np.asarray(cv2.GaussianBlur(bottom, (0, 0), 1.5), np.float32)
        fresh = ~known & (bottom > enough)
        result[:, fresh] = top[:, fresh] / bottom[fresh]
        known |= fresh
    result[:, ~known] = result[:, known].mean(axis=1, keepdims=True)
    return result


def _stiffened(stencil: Image, image: Image, strength: float, epsilon: float) -> Image:
    """The stencil plus the prior's, reweighted at the current image."""
    size = np.zeros_like(image[0])
    down, right = np.diff(image, axis=1), np.diff(image, axis=2)
    size[:-1] += (down * down).sum(axis=0)
    size[:, :-1] += (right * right).sum(axis=0)
    size = np.asarray(cv2.GaussianBlur(size, (3, 3), 0.7), np.float32)
    stiffness = (strength / np.sqrt(size + epsilon * epsilon)).astype(np.float32)
    across = 0.5 * (stiffness[:, :-1] + stiffness[:, 1:])
    along = 0.5 * (stiffness[:-1] + stiffness[1:])
    result = stencil.copy()
    result[1, :, :-1] -= across
    result[2, :-1] -= along
    result[0, :, :-1] += across
    result[0, :, 1:] += across
    result[0, :-1] += along
    result[0, 1:] += along
    return result


def _conjugate_gradients(stencil: Image, right: Image, start: Image, steps: int) -> Image:
    x = start.copy()
    inverse: Image = np.reciprocal(stencil[0])
    product = np.empty_like(x)
    _apply(stencil, x, product)
    residual = right - product
    z = inverse * residual
    direction = z.copy()
    energy = float(np.vdot(residual, z))
    for _ in range(steps):
        if not energy > 0:
            break
        _apply(stencil, direction, product)
        step = np.float32(energy / float(np.vdot(direction, product)))
        x += step * direction
        residual -= step * product
        np.multiply(inverse, residual, out=z)
        previous, energy = energy, float(np.vdot(residual, z))
        direction *= np.float32(energy / previous)
        direction += z
    return x


@numba.njit(cache=True, parallel=True, fastmath=True)
def _accumulate(values, weights, positions, row0, column0, grid, rows, columns):  # type: ignore[no-untyped-def]
    channels, count, height, width = values.shape
    parts = 2  # fixed, so that the sums do not depend on the number of threads
    stencil = np.zeros((parts, 5, rows, columns), dtype=np.float32)
    right = np.zeros((parts, channels, rows, columns), dtype=np.float32)
    for part in numba.prange(parts):
        S, b = stencil[part], right[part]
        for k in range(part, count, parts):
            for i in range(height):
                for j in range(width):
                    w = weights[k, i, j]
                    if w <= 0.0:
                        continue
                    r = (positions[k, i, j, 0] - np.float32(row0)) * np.float32(grid)
                    c = (positions[k, i, j, 1] - np.float32(column0)) * np.float32(grid)
                    m, n = int(r), int(c)
                    a, d = np.float32(r - m), np.float32(c - n)
                    one = np.float32(1.0)
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


@numba.njit(cache=True, parallel=True, fastmath=True)
def _apply(S, images, products):  # type: ignore[no-untyped-def]
    channels, rows, columns = images.shape
    for item in numba.prange(channels * rows):
        x, out, i = images[item // rows], products[item // rows], item % rows
        for j in range(columns):
            value = S[0, i, j] * x[i, j]
            if j + 1 < columns:
                value += S[1, i, j] * x[i, j + 1]
            if j > 0:
                value += S[1, i, j - 1] * x[i, j - 1]
            if i + 1 < rows:
                value += S[2, i, j] * x[i + 1, j]
                if j + 1 < columns:
                    value += S[3, i, j] * x[i + 1, j + 1]
                if j > 0:
                    value += S[4, i, j] * x[i + 1, j - 1]
            if i > 0:
                value += S[2, i - 1, j] * x[i - 1, j]
                if j > 0:
                    value += S[3, i - 1, j - 1] * x[i - 1, j - 1]
                if j + 1 < columns:
                    value += S[4, i - 1, j + 1] * x[i - 1, j + 1]
            out[i, j] = value
