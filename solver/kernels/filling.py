"""Filling of unknown pixels: from the nearest known one, and smoothly."""

import numpy as np
from numba import njit


@njit(cache=True)
def take(labels, known, values):  # type: ignore[no-untyped-def]
    """values ← at unknown pixels that of the known pixel with the same label, in place; (rows, columns).

    There must be such a one for every label.

    Args:
        labels: (rows, columns).
        known: (rows, columns).
        values: (rows, columns), any unit.
    """
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
    """total ← total / share and known ← true where the share is over `least`, else 0 and false.

    Args:
        total: (rows, columns), in place.
        share: (rows, columns).
        least: what a share must exceed.
        known: (rows, columns) ←.
    """
    rows, columns = total.shape
    for i in range(rows):
        t, s, k = total[i], share[i], known[i]
        for j in range(columns):
            k[j] = s[j] > least
        for j in range(columns):
            t[j] = t[j] / s[j] if s[j] > least else total.dtype.type(0)


@njit(cache=True)
def relax(values, rows, columns, sweeps, over):  # type: ignore[no-untyped-def]
    """Gauss–Seidel sweeps with over-relaxation of Laplace's equation at the listed pixels, in place.

    A pixel stands for the neighbours that it lacks. It is quick where no pixel is next to the one before it.

    Args:
        values: (image rows, image columns), any unit, in place.
        rows: (n,), of the pixels.
        columns: (n,), of the pixels.
        sweeps: how many.
        over: factor on each step.
    """
    height, width = values.shape
    flat, factor, quarter = values.reshape(-1), values.dtype.type(over), values.dtype.type(0.25)
    around = np.empty((rows.size, 5), np.uintp)
    for n in range(rows.size):
        i, j = rows[n], columns[n]
        around[n, 0] = i * width + j
        around[n, 1], around[n, 2] = max(i - 1, 0) * width + j, min(i + 1, height - 1) * width + j
        around[n, 3], around[n, 4] = i * width + max(j - 1, 0), i * width + min(j + 1, width - 1)
    for _ in range(sweeps):
        for n in range(rows.size):
            here, a = around[n, 0], around[n]
            total = (flat[a[1]] + flat[a[2]]) + (flat[a[3]] + flat[a[4]])
            flat[here] += factor * (quarter * total - flat[here])
