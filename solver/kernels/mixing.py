"""Giving the mixed pixels of a map to one of the surfaces beside them."""

import numpy as np
from numba import njit, prange


@njit(error_model="numpy")
def _between(z, y, x):  # type: ignore[no-untyped-def]
    """The map (2, rows, columns) at a place, bilinearly; its border beyond it."""
    rows, columns = z.shape[1], z.shape[2]
    y, x = min(max(y, 0.0), rows - 1.0), min(max(x, 0.0), columns - 1.0)
    i, j = max(min(int(y), rows - 2), 0), max(min(int(x), columns - 2), 0)
    below, right = min(i + 1, rows - 1), min(j + 1, columns - 1)
    v, u = y - i, x - j
    w00, w01, w10, w11 = (1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u
    real = w00 * z[0, i, j] + w01 * z[0, i, right] + w10 * z[0, below, j] + w11 * z[0, below, right]
    other = w00 * z[1, i, j] + w01 * z[1, i, right] + w10 * z[1, below, j] + w11 * z[1, below, right]
    return real, other


@njit(parallel=True, cache=True, error_model="numpy")
def assign(z, vertical, horizontal, both, least, step, contrast, off_line, out):  # type: ignore[no-untyped-def]
    """out (2, rows, columns) ← z with mixtures replaced by the surface that has the larger share.

    Args:
        vertical, horizontal, both: (rows, columns), the structure tensor; least: its trace on an edge.
        step: pixels to either side at which one surface is seen alone; contrast: |P − M| of an edge.
        off_line: distance from the line between P and M, in lengths of it, from which z is no mixture.
    """
    rows, columns = vertical.shape
    for i in prange(rows):
        for j in range(columns):
            here, also = z[0, i, j], z[1, i, j]
            out[0, i, j], out[1, i, j] = here, also
            if not vertical[i, j] + horizontal[i, j] > least:
                continue
            angle = 0.5 * np.arctan2(2 * both[i, j], horizontal[i, j] - vertical[i, j])
            down, right = step * np.sin(angle), step * np.cos(angle)
            p0, p1 = _between(z, i + down, j + right)
            m0, m1 = _between(z, i - down, j - right)
            d0, d1, a0, a1 = p0 - m0, p1 - m1, here - m0, also - m1
            square = d0 * d0 + d1 * d1
            if not square > contrast * contrast:
                continue
            share = (a0 * d0 + a1 * d1) / square
            e0, e1 = a0 - share * d0, a1 - share * d1
            if 0 < share < 1 and e0 * e0 + e1 * e1 < off_line * off_line * square:
                out[0, i, j], out[1, i, j] = (p0, p1) if share > 0.5 else (m0, m1)
