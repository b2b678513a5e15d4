"""Symmetric nine-point operators on images, and the solution of their linear systems.

An operator is five coefficient images (5, rows, columns): the diagonal and the couplings of each node to its
neighbours to the right, below, below right and below left; the other four follow by symmetry. The kernels run
on one thread: each takes a fraction of a millisecond, less than waking another thread on a busy machine.
"""

import numba
import numpy as np
from numpy.typing import NDArray

import solver.kernels  # noqa: F401  tells Numba's cache what kernels are compiled from

Image = NDArray[np.float32]


def conjugate_gradients(
    stencil: Image,
    right: Image,
    start: Image,
    *,
    steps: int,
    tolerance: float = 0.0,
) -> tuple[Image, int]:
    """Solve stencil · image = right for every channel of (C, rows, columns), preconditioned by the diagonal.

    Args:
        steps: the most steps taken.
        tolerance: stop where the residual has fallen to this part of `right`, in the preconditioner's norm.

    Returns:
        the image and the number of steps taken.
    """
    image = start.copy()
    residual, product, direction = np.empty((3, *start.shape), np.float32)
    _multiply(stencil, image, residual)
    np.subtract(right, residual, out=residual)
    direction[:] = 0
    energy, ratio = float(_energy(stencil[0], residual)), 0.0
    enough = tolerance**2 * float(_energy(stencil[0], right))
    for step in range(steps):
        if not energy > enough:
            return image, step
        _turn(stencil[0], residual, direction, ratio)
        length = energy / float(_multiply(stencil, direction, product))
        fresh = float(_advance(stencil[0], image, residual, direction, product, length))
        ratio, energy = fresh / energy, fresh
    return image, steps


@numba.njit(cache=True, fastmath=True)
def _multiply(S, images, products):  # type: ignore[no-untyped-def]
    """products = stencil · images; returns ⟨images, products⟩."""
    channels, rows, columns = images.shape
    total = 0.0
    for i in range(rows):
        zero = np.zeros(columns, dtype=np.float32)
        up, low = max(i - 1, 0), min(i + 1, rows - 1)
        centre, east, south, southeast, southwest = S[0, i], S[1, i], S[2, i], S[3, i], S[4, i]
        north = S[2, up] if i > 0 else zero
        northwest = S[3, up] if i > 0 else zero
        northeast = S[4, up] if i > 0 else zero
        for h in range(channels):
            x, above, below, out = images[h, i], images[h, up], images[h, low], products[h, i]
            dot = np.float32(0.0)
            last = columns - 1
            # Views instead of j - 1 and j + 1, which would need a check for wrapping and stop vectorisation.
            x_w, x_c, x_e, out_c = x[:-2], x[1:-1], x[2:], out[1:-1]
            a_w, a_c, a_e, b_w, b_c, b_e = (
                above[:-2],
                above[1:-1],
                above[2:],
                below[:-2],
                below[1:-1],
                below[2:],
            )
            k_c, k_e, k_w, k_s, k_n = centre[1:-1], east[1:-1], east[:-2], south[1:-1], north[1:-1]
            k_se, k_sw, k_nw, k_ne = southeast[1:-1], southwest[1:-1], northwest[:-2], northeast[2:]
            for j in range(columns - 2):
                value = k_c[j] * x_c[j] + k_e[j] * x_e[j] + k_w[j] * x_w[j]
                value += k_s[j] * b_c[j] + k_se[j] * b_e[j] + k_sw[j] * b_w[j]
                value += k_n[j] * a_c[j] + k_nw[j] * a_w[j] + k_ne[j] * a_e[j]
                out_c[j] = value
                dot += value * x_c[j]
            out[0] = centre[0] * x[0] + east[0] * x[1] + south[0] * below[0] + southeast[0] * below[1]
            out[0] += north[0] * above[0] + northeast[1] * above[1]
            out[last] = centre[last] * x[last] + east[last - 1] * x[last - 1]
            out[last] += south[last] * below[last] + southwest[last] * below[last - 1]
            out[last] += north[last] * above[last] + northwest[last - 1] * above[last - 1]
            total += dot + out[0] * x[0] + out[last] * x[last]
    return total


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _energy(diagonal, residual):  # type: ignore[no-untyped-def]
    channels, rows, columns = residual.shape
    total = 0.0
    for i in range(rows):
        dot = np.float32(0.0)
        for h in range(channels):
            for j in range(columns):
                dot += residual[h, i, j] * residual[h, i, j] / diagonal[i, j]
        total += float(dot)
    return total


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _turn(diagonal, residual, direction, ratio):  # type: ignore[no-untyped-def]
    channels, rows, columns = residual.shape
    keep = np.float32(ratio)
    for i in range(rows):
        for h in range(channels):
            for j in range(columns):
                direction[h, i, j] = residual[h, i, j] / diagonal[i, j] + keep * direction[h, i, j]


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _advance(diagonal, image, residual, direction, product, step):  # type: ignore[no-untyped-def]
    channels, rows, columns = residual.shape
    length = np.float32(step)
    total = 0.0
    for i in range(rows):
        dot = np.float32(0.0)
        for h in range(channels):
            for j in range(columns):
                image[h, i, j] += length * direction[h, i, j]
                left = residual[h, i, j] - length * product[h, i, j]
                residual[h, i, j] = left
                dot += left * left / diagonal[i, j]
        total += float(dot)
    return total
