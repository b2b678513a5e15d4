"""A sweep over a mosaic's normal equations; see `registration.sweep`."""

import numpy as np
from numba import njit

from solver.kernels.barrier import meet, take

BANDS = 4  # of rows, each swept on its own: as many threads may share a sweep, whose result is the same


@njit(cache=True, nogil=True)
def relax_rows(counter, sums, image, into, strength, epsilon2):  # type: ignore[no-untyped-def]
    """A sweep by a team.

    Args:
        counter: (1,), see `kernels.barrier`.
        sums: (5 + C, rows, columns), stencil and right sides.
        image: (C, rows, columns), in deviations.
        into: (C, rows, columns) ← one that fits better.
        strength: λ, in units of 1 / σ.
        epsilon2: ε², deviations².
    """
    band = take(counter)
    while band < BANDS:
        _relax_band(band, sums, image, into, strength, epsilon2, np.float32(1), sums[:0])
        band = take(counter)


@njit(cache=True, nogil=True)
def relax_and_fade(rank, size, barrier, sums, image, into, strength, epsilon2, keep, rest):  # type: ignore[no-untyped-def]
    """A sweep by a team, after which the sums fade.

    Args:
        barrier: (places,), see `kernels.barrier`.
        sums: (5 + C, rows, columns), stencil and right sides.
        image: (C, rows, columns), in deviations.
        into: (C, rows, columns) ← one that fits better.
        strength: λ, in units of 1 / σ.
        epsilon2: ε², deviations².
        keep: what is left of the sums.
        rest: (5 + C, rows, columns), what takes the place of the remainder.
    """
    for band in range(rank, BANDS, size):
        _relax_band(band, sums, image, into, strength, epsilon2, keep, rest)
    meet(barrier, size)  # a band's last row is in the first equations of the next one
    for band in range(rank, BANDS, size):
        _fade_row(sums, rest, (band + 1) * sums.shape[1] // BANDS - 1, keep)


@njit(cache=True)
def _relax_band(band, sums, image, into, strength, epsilon2, keep, rest):  # type: ignore[no-untyped-def]
    """A sweep over a band, of which all sums but those of the last row fade, unless `rest` is empty."""
    rows, columns = image.shape[1:]
    scratch, fades = np.zeros((8, columns), np.float32), len(rest) > 0
    begin, end = band * rows // BANDS, (band + 1) * rows // BANDS
    _stiffen(image, begin - 1, strength, epsilon2, scratch)
    _stiffen(image, begin, strength, epsilon2, scratch)
    for i in range(begin, end):
        _stiffen(image, i + 1, strength, epsilon2, scratch)
        _solve_row(sums, image, into, i, begin, end, scratch)
        if fades and i > begin:
            _fade_row(sums, rest, i - 1, keep)


@njit(cache=True, fastmath=True)
def _fade_row(sums, rest, i, keep):  # type: ignore[no-untyped-def]
    more = np.float32(1.0) - keep
    for h in range(len(sums)):
        row, added = sums[h, i], rest[h, i]
        for j in range(len(row)):
            row[j] = keep * row[j] + more * added[j]


@njit(cache=True, fastmath=True, error_model="numpy")
def _stiffen(image, i, strength, epsilon2, scratch):  # type: ignore[no-untyped-def]
    """λ / √(|∇U|² + ε²) of a row, |∇U|² the mean over both sides: one alone would shift what is smoothed.

    A mean over 3 × 3 nodes would hold edges less well.
    """
    channels, rows, columns = image.shape
    if i < 0 or i == rows:
        return
    up, low, last = max(i - 1, 0), min(i + 1, rows - 1), columns - 1
    half = np.float32(0.5)
    stiffness = scratch[i % 3]
    out = stiffness[1:-1]
    out[:] = epsilon2
    for h in range(channels):
        x, top, bottom = image[h, i, 1:-1], image[h, up, 1:-1], image[h, low, 1:-1]
        before, after = image[h, i, :-2], image[h, i, 2:]
        for j in range(columns - 2):
            a, b, c, d = x[j] - before[j], after[j] - x[j], x[j] - top[j], bottom[j] - x[j]
            out[j] += half * (a * a + b * b + c * c + d * d)
    for j in range(columns - 2):
        out[j] = strength / np.sqrt(out[j])
    stiffness[0], stiffness[last] = stiffness[1], stiffness[last - 1]


@njit(cache=True, fastmath=True)
def _solve_row(sums, image, into, i, begin, end, scratch):  # type: ignore[no-untyped-def]
    """A Jacobi step of row i of the band from `begin` to `end`."""
    channels, rows, columns = image.shape
    upper = into if i > begin else image
    up, low, last = max(i - 1, 0), min(i + 1, rows - 1), columns - 1
    above, own, below = scratch[(i + 2) % 3], scratch[i % 3], scratch[(i + 1) % 3]
    inverse, east, north, south, zero = scratch[3], scratch[4], scratch[5], scratch[6], scratch[7]
    s_nw, s_ne = (sums[3, up], sums[4, up]) if i > 0 else (zero, zero)
    s_se, s_sw = sums[3, i], sums[4, i]
    for j in range(columns):
        inverse[j] = sums[0, i, j]
    _couple(sums[1, i, :-1], own[:-1], own[1:], east[:-1], inverse[:-1])
    if i > 0:
        _couple(sums[2, up], own, above, north, inverse)
    else:
        north[:] = 0
    if i + 1 < rows:
        _couple(sums[2, i], own, below, south, inverse)
    else:
        south[:] = 0
    _invert(own, inverse)
    for h in range(channels):
        x, a, b, right, out = image[h, i], upper[h, up], image[h, low], sums[5 + h, i], into[h, i]
        _relax(x, a, b, right, inverse, east, south, s_se, s_sw, north, s_nw, s_ne, out)
        value = right[0] - east[0] * x[1] - south[0] * b[0] - s_se[0] * b[1]
        out[0] = (value - north[0] * a[0] - s_ne[1] * a[1]) * inverse[0]
        value = right[last] - east[last - 1] * x[last - 1] - south[last] * b[last] - s_sw[last] * b[last - 1]
        out[last] = (value - north[last] * a[last] - s_nw[last - 1] * a[last - 1]) * inverse[last]
        if i == begin > 0:
            _hold_back(x, north, s_nw[:-1], s_ne[1:], inverse, zero, out)
        if i + 1 == end < rows:
            _hold_back(x, south, s_sw[1:], s_se[:-1], inverse, zero, out)


@njit(cache=True, fastmath=True)
def _couple(data, own, other, coupling, diagonal):  # type: ignore[no-untyped-def]
    """The couplings between two rows, or neighbours in one, with the prior's, which the diagonal gains."""
    half = np.float32(0.5)
    for j in range(len(coupling)):
        coupling[j] = data[j] - half * (own[j] + other[j])
    for j in range(len(coupling)):
        diagonal[j] += half * (own[j] + other[j])


@njit(cache=True, fastmath=True)
def _hold_back(x, straight, before, after, inverse, spare, out):  # type: ignore[no-untyped-def]
    """Shorten a row's step as if half of what couples it to another band, which is old, were on its diagonal.

    Otherwise two bands may drive each other, ever further, where there are few samples.
    """
    one, half = np.float32(1.0), np.float32(0.5)
    inner, outer = spare[1:], spare[:-1]
    for j in range(len(spare)):
        spare[j] = abs(straight[j])
    for j in range(len(before)):
        inner[j] += before[j]
    for j in range(len(after)):
        outer[j] += after[j]
    for j in range(len(out)):
        out[j] = x[j] + (out[j] - x[j]) / (one + half * spare[j] * inverse[j])
    spare[:] = 0


@njit(cache=True, fastmath=True, error_model="numpy")
def _invert(own, diagonal):  # type: ignore[no-untyped-def]
    """The reciprocal of a row's diagonal, which still lacks the prior's couplings to the left."""
    half, one = np.float32(0.5), np.float32(1.0)
    before, after, rest = own[:-1], own[1:], diagonal[1:]
    diagonal[0] = one / diagonal[0]
    for j in range(len(rest)):
        rest[j] = one / (rest[j] + half * (before[j] + after[j]))


@njit(cache=True, fastmath=True)
def _relax(x, a, b, right, inverse, east, south, s_se, s_sw, north, s_nw, s_ne, out):  # type: ignore[no-untyped-def]
    """All but the first and the last node of a row, from its own values and those above and below."""
    # Views instead of j - 1 and j + 1, which would need a check for wrapping and stop vectorisation.
    x_w, x_e, out_c, right_c, i_c = x[:-2], x[2:], out[1:-1], right[1:-1], inverse[1:-1]
    a_w, a_c, a_e, b_w, b_c, b_e = a[:-2], a[1:-1], a[2:], b[:-2], b[1:-1], b[2:]
    k_e, k_w, k_s, k_n = east[1:-1], east[:-2], south[1:-1], north[1:-1]
    k_se, k_sw, k_nw, k_ne = s_se[1:-1], s_sw[1:-1], s_nw[:-2], s_ne[2:]
    for j in range(len(out_c)):
        value = k_e[j] * x_e[j] + k_w[j] * x_w[j]
        value += k_s[j] * b_c[j] + k_se[j] * b_e[j] + k_sw[j] * b_w[j]
        value += k_n[j] * a_c[j] + k_nw[j] * a_w[j] + k_ne[j] * a_e[j]
        out_c[j] = (right_c[j] - value) * i_c[j]
