"""Filling of unknown pixels: from the nearest known one, and smoothly."""

import numpy as np
from numba import njit


@njit(cache=True)
def take(labels, known, values):  # type: ignore[no-untyped-def]
    """values ← at unknown pixels that of the known pixel with the same label, in place; (rows, columns)."""
    rows, columns = known.shape
    table = np.empty(rows * columns + 1, values.dtype)
    for i in range(rows):
        for j in range(columns):
            if known[i, j]:
                table[labels[i, j]] = values[i, j]
    for i in range(rows):
        for j in range(columns):
            if not known[i, j]:
                values[i, j] = table[labels[i, j]]


@njit(cache=True, fastmath=True, error_model="numpy")
def divide(total, share, least, known):  # type: ignore[no-untyped-def]
    """total ← total / share and known ← true where the share is over `least`, else 0 and false."""
    rows, columns = total.shape
    for i in range(rows):
        t, s, k = total[i], share[i], known[i]
        for j in range(columns):
            k[j] = s[j] > least
        for j in range(columns):
            t[j] = t[j] / s[j] if s[j] > least else total.dtype.type(0)


@njit(cache=True)
def relax(values, rows, columns, sweeps, over):  # type: ignore[no-untyped-def]
    """Gauss–Seidel sweeps with over-relaxation of Laplace's equation at the listed pixels, in place."""
    height, width = values.shape
    for _ in range(sweeps):
        for n in range(rows.size):
            i, j = rows[n], columns[n]
            total, count = 0.0, 0
            if i > 0:
                total, count = total + values[i - 1, j], count + 1
            if i + 1 < height:
                total, count = total + values[i + 1, j], count + 1
            if j > 0:
                total, count = total + values[i, j - 1], count + 1
            if j + 1 < width:
                total, count = total + values[i, j + 1], count + 1
            if count:
                values[i, j] += over * (total / count - values[i, j])
