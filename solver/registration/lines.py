"""What the pixels of a row or of a column err by in common."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.sums import WITHIN

Image = NDArray[np.float32]


def lines_of(shape: tuple[int, int]) -> Image:
    """Room for four sums: what each row, then each column, tells of a displacement, and its pull."""
    return np.empty((4, max(shape)), np.float32)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def share_errors(terms, pixel, used, width, error2, lines):  # type: ignore[no-untyped-def]
    """Lower the weights of samples that err alike.

    An edge along a row of pixels crosses all of them at the same place, so where a mosaic cannot follow it,
    they all are off by the same displacement, however many they are: together they know it no better than
    that. Of Σ w U_y² = I, what a row tells of a displacement across it, is left I / (1 + (e² + d²) I); e is
    the mosaic's own error, d what the row is off as a whole. So it is with columns and U_x; a sample's weight
    falls by the mean of both, weighted with its slopes squared. Without this a table's edge that spans the
    image displaces the frame whose rows lie along it by 0.05 px.

    Args:
        terms: as in `equations`: ΣU_y², –, ΣU_x², ΣU_y r, ΣU_x r, –, weights, which are changed.
        pixel: numbers of the pixels in their image, `width` a row.
        used: how many samples there are.
        error2: e².
        lines: from `lines_of`.
    """
    yy, xx, yr, xr, weight = terms[0], terms[2], terms[3], terms[4], terms[6]
    one, least = np.float32(1.0), np.float32(1e-30)
    lines[:] = 0
    for s in range(used):
        i, w = (pixel[s] // width) & WITHIN, weight[s]
        j = (pixel[s] - i * width) & WITHIN
        lines[0, i] += w * yy[s]
        lines[1, j] += w * xx[s]
        lines[2, i] += w * yr[s]
        lines[3, j] += w * xr[s]
    for h in range(2):
        told, pull = lines[h], lines[2 + h]
        for i in range(len(told)):
            away = pull[i] / max(told[i], least)
            told[i] = one / (one + (error2 + away * away) * told[i])
    for s in range(used):
        i = (pixel[s] // width) & WITHIN
        j = (pixel[s] - i * width) & WITHIN
        down, across = yy[s], xx[s]
        weight[s] *= (down * lines[0, i] + across * lines[1, j]) / (down + across + least)
