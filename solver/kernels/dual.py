"""The dual variables of the group prior, six differences a pixel in one group, and ∇ᵀ of them."""

import numpy as np
from numba import njit

from solver.kernels.group import COLUMNS, ROWS
from solver.kernels.view import view


@njit(fastmath=True)
def _subtract(a, b, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = a[j] - b[j]


@njit(fastmath=True)
def _add_fall(down, fall, right, run, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] += down * fall[j] + right * run[j]


@njit(fastmath=True)
def _scale(a, b, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] *= a[j] * b[j]


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def duals(rank, size, x, slope, norms, radius, epsilon, up, out):  # type: ignore[no-untyped-def]
    """out (C, 6, rows + 4, columns + 4) ← radius · (∇x − slope) / max(norms, ε), every group in its ball.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column, or (C, 2, 0,
            0) = level.
        norms: (rows + 4, columns + 4), padded by 2, ‖∇x − slope‖.
        radius: (rows + 4, columns + 4), padded by 2, of the balls, in units of λ.
        epsilon: ε, in units of λ.
        up: (3, 6, columns), of `kernels.group.tables`.
        out: (C, 6, rows + 4, columns + 4), in units of λ.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    x_type, slack, roots = x.dtype.type, np.empty(n, x.dtype), np.sqrt(up)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i, kind = row + 2, max(0, row + 3 - rows)
        for j in range(n):
            slack[j] = radius[i, 2 + j] / max(norms[i, 2 + j], epsilon)
        for c in range(channels):
            for k in range(6):
                down, right = ROWS[k], COLUMNS[k]
                here, there = view(x, (c, i), 2, n), view(x, (c, i + down), 2 + right, n)
                target = view(out, (c, k, i), 2, n)
                _subtract(here, there, target)
                if slope.shape[2] > 0:
                    fall, run = view(slope, (c, 0, i), 2, n), view(slope, (c, 1, i), 2, n)
                    _add_fall(x_type(down), fall, x_type(right), run, target)
                _scale(slack, view(roots, (kind, k), 0, n), target)


@njit(nogil=True, fastmath=True, cache=True)
def transpose(rank, size, dual, weights, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← ∇ᵀ dual, one channel (6, rows + 4, columns + 4), in out's precision.

    Args:
        dual: (6, rows + 4, columns + 4), in units of λ.
        weights: (6,), of the differences, 1 / pixel.
        out: (rows, columns).
    """
    rows, n = out.shape
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        a0, b0 = view(dual, (0, i), 2, n), view(dual, (0, i), 1, n)
        a1, b1 = view(dual, (1, i), 2, n), view(dual, (1, i - 1), 2, n)
        a2, b2 = view(dual, (2, i), 2, n), view(dual, (2, i - 1), 1, n)
        a3, b3 = view(dual, (3, i), 2, n), view(dual, (3, i - 1), 3, n)
        a4, b4 = view(dual, (4, i), 2, n), view(dual, (4, i), 0, n)
        a5, b5 = view(dual, (5, i), 2, n), view(dual, (5, i - 2), 2, n)
        target = view(out, (row,), 0, n)
        for j in range(n):
            value = w0 * (float(a0[j]) - b0[j]) + w1 * (float(a1[j]) - b1[j])
            value += w2 * (float(a2[j]) - b2[j]) + w3 * (float(a3[j]) - b3[j])
            target[j] = value + w4 * (float(a4[j]) - b4[j]) + w5 * (float(a5[j]) - b5[j])


@njit(fastmath=True, cache=True)
def divide(spectrum, row, column):  # type: ignore[no-untyped-def]
    """spectrum (rows, columns) ← spectrum / (row + column), 0 at (0, 0).

    Args:
        spectrum: (rows, columns), in place.
        row: (rows,).
        column: (columns,).
    """
    for i in range(row.size):
        for j in range(column.size):
            spectrum[i, j] /= row[i] + column[j] if i + j > 0 else spectrum.dtype.type(np.inf)


@njit(nogil=True, fastmath=True, cache=True)
def carry(rank, size, dual, potential, weights):  # type: ignore[no-untyped-def]
    """Take the weighted differences of a potential (rows, columns) off one channel's unit differences.

    Args:
        dual: (6, rows + 4, columns + 4), in place.
        potential: (rows, columns).
        weights: (6,), of the differences, 1 / pixel.
    """
    rows, n = potential.shape
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        here, across, along = potential[row], dual[0, row + 2, 2 : 2 + n], dual[1, row + 2, 2 : 2 + n]
        right, below = here[1:], potential[min(row + 1, rows - 1)]
        for j in range(n - 1):
            across[j] -= weights[0] * (here[j] - right[j])
        for j in range(n):
            along[j] -= weights[1] * (here[j] - below[j])


@njit(fastmath=True)
def _add_square(values, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] += values[j] * values[j]


@njit(fastmath=True)
def _fall(values, down, fall, right, run):  # type: ignore[no-untyped-def]
    """Σ values · (down · fall + right · run), one row."""
    total = values.dtype.type(0)
    for j in range(values.size):
        total += values[j] * (down * fall[j] + right * run[j])
    return total


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def extent(rank, size, dual, radius, weights, tilt, sums):  # type: ignore[no-untyped-def]
    """sums (2, rows) ← by row the largest (‖group‖ / radius)² of all channels' duals, and −⟨duals, slope⟩.

    Args:
        dual: (C, 6, rows + 4, columns + 4), in units of λ.
        radius: (rows + 4, columns + 4), padded by 2, of the balls, in units of λ.
        weights: (6,), of the differences, 1 / pixel.
        tilt: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column, or (C, 2, 0,
            0) = level.
        sums: (2, rows), in float64.
    """
    channels, rows, n = dual.shape[0], dual.shape[2] - 4, dual.shape[3] - 4
    x_type, square = dual.dtype.type, np.empty(n, dual.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        reach, product = radius[i, 2 : 2 + n], 0.0
        square[:] = 0
        for c in range(channels):
            for k in range(6):
                p = dual[c, k, i, 2 : 2 + n]
                _add_square(p, square)
                if tilt.shape[2] > 0:
                    fall, run = tilt[c, 0, i, 2 : 2 + n], tilt[c, 1, i, 2 : 2 + n]
                    part = _fall(p, x_type(ROWS[k]), fall, x_type(COLUMNS[k]), run)
                    product += float(weights[k]) * float(part)
        largest = dual.dtype.type(0)
        for j in range(n):
            largest = max(largest, square[j] / (reach[j] * reach[j]))
        sums[0, row], sums[1, row] = largest, product


@njit(nogil=True, fastmath=True, cache=True)
def add_scaled(rank, size, out, pull, curvature, factor, sums):  # type: ignore[no-untyped-def]
    """out (rows, columns) += pull + factor · curvature, both padded by 2; sums (rows,) ← its sum by row.

    Args:
        out: (rows, columns).
        pull: (rows + 4, columns + 4), padded by 2.
        curvature: (rows + 4, columns + 4), padded by 2.
        factor: a number.
        sums: (rows,), in float64.
    """
    rows, n = out.shape
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        target, a, b = out[row], pull[row + 2, 2 : 2 + n], curvature[row + 2, 2 : 2 + n]
        total = 0.0
        for j in range(n):
            target[j] += a[j] + factor * b[j]
            total += target[j]
        sums[row] = total
