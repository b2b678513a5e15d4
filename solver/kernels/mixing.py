"""Giving the mixed pixels of a map to one of the surfaces beside them."""

import numpy as np
from numba import njit

from solver.kernels.smoothing import across, along, mirrored

_TILE_ROWS = 32
"""Rows walked together: what they need fits the second-level cache."""


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


@njit
def _pad(line, width, n):  # type: ignore[no-untyped-def]
    """Fill `width` entries on either side of the n in the middle with their mirror image."""
    for k in range(1, width + 1):
        line[width - k] = line[width + mirrored(k, n)]
        line[width + n - 1 + k] = line[width + mirrored(n - 1 + k, n)]


@njit(fastmath=True)
def _add_tensor(image, i, tensor, lines):  # type: ignore[no-untyped-def]
    """Add one channel's structure tensor at row i, of eight times its gradient (Sobel), to tensor (3, n)."""
    rows, n = image.shape
    above, here, below = image[mirrored(i - 1, rows)], image[i], image[mirrored(i + 1, rows)]
    change, total = lines[0, : n + 2], lines[1, : n + 2]
    for j in range(n):
        change[j + 1] = below[j] - above[j]
        total[j + 1] = above[j] + here[j] + here[j] + below[j]
    _pad(change, 1, n)
    _pad(total, 1, n)
    down2, right2, both = tensor[0], tensor[1], tensor[2]
    for j in range(n):
        down, right = change[j] + change[j + 1] + change[j + 1] + change[j + 2], total[j + 2] - total[j]
        down2[j] += down * down
        right2[j] += right * right
        both[j] += down * right


@njit(error_model="numpy")
def _settle(z, i, j, down2, right2, both, step, contrast, off_line, out):  # type: ignore[no-untyped-def]
    """Give pixel (i, j) to one side if it is a mixture; down², right² and both of its structure tensor."""
    difference, double = float(right2 - down2), 2 * float(both)
    length = np.sqrt(difference * difference + double * double)
    if length > 0:  # half the angle of (difference, double): the gradient's
        down = step * np.sqrt(max(0.0, 0.5 - 0.5 * difference / length))
        right = step * np.sqrt(max(0.0, 0.5 + 0.5 * difference / length))
        down = -down if double < 0 else down
    else:
        down, right = 0.0, step
    p0, p1 = _between(z, i + down, j + right)
    m0, m1 = _between(z, i - down, j - right)
    d0, d1, a0, a1 = p0 - m0, p1 - m1, z[0, i, j] - m0, z[1, i, j] - m1
    square = d0 * d0 + d1 * d1
    if not square > contrast * contrast:
        return
    share = (a0 * d0 + a1 * d1) / square
    e0, e1 = a0 - share * d0, a1 - share * d1
    if 0 < share < 1 and e0 * e0 + e1 * e1 < off_line * off_line * square:
        out[0, i, j], out[1, i, j] = (p0, p1) if share > 0.5 else (m0, m1)


@njit(nogil=True, cache=True, error_model="numpy")
def assign(rank, size, z, taps, least, step, contrast, off_line, out):  # type: ignore[no-untyped-def]
    """out (2, rows, columns) ← z with mixtures replaced by the surface that has the larger share.

    Args:
        taps: of the Gaussian that averages the structure tensor; least: the tensor's trace on an edge.
        step: pixels to either side at which one surface is seen alone; contrast: |P − M| of an edge.
        off_line: distance from the line between P and M, in lengths of it, from which z is no mixture.
    """
    rows, columns = z.shape[1:]
    tiles, reach = max(1, rows // _TILE_ROWS), taps.size - 1
    for tile in range(rank * tiles // size, (rank + 1) * tiles // size):
        top, end = tile * rows // tiles, (tile + 1) * rows // tiles
        tensors = np.zeros((3, end - top + 2 * reach, columns), z.dtype)
        lines, smooth = np.zeros((2, columns + 2), z.dtype), np.zeros((3, columns), z.dtype)
        line = np.zeros(columns + 2 * reach, z.dtype)
        for r in range(end - top + 2 * reach):
            for c in range(2):
                _add_tensor(z[c], mirrored(top - reach + r, rows), tensors[:, r], lines)
        for i in range(top, end):
            for k in range(3):
                across(tensors[k], i - top + reach, len(tensors[k]), taps, line[reach : reach + columns])
                along(line, taps, smooth[k])
            out[0, i], out[1, i] = z[0, i], z[1, i]
            for j in range(columns):
                if smooth[0, j] + smooth[1, j] > least:
                    tensor = (smooth[0, j], smooth[1, j], smooth[2, j])
                    _settle(z, i, j, *tensor, step, contrast, off_line, out)
