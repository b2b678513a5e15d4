"""Heavy-tailed penalties on pairs of pixels: their quadratic majorants and the Gauss–Newton right-hand side.

The state is (2, rows + 4, columns + 4): log-amplitude l and phase φ of Z = exp(l + iφ), padded by 2. A pair k
of neighbours (see `ROWS`, `COLUMNS`) costs

    κ w log(1 + (d / δ)²),    d = their difference, for φ less the slope's part and modulo 2π,

for φ times |Z|^¼ and divided by 1 + (Δl / e)² and by what it is loosened by; it lies under ½ W d² + constant
with W = 2 κ w / (δ² + d²), likewise.
Strengths W are (4, rows + 4, columns + 4), 0 where a pair leaves the image, and shortened (see
`kernels.elementary`): a round of conjugate gradients waits for memory, and it does not matter by which
majorant a step is found.
"""

import numpy as np
from numba import njit

from solver.kernels.elementary import lengthen, logarithm, shorten
from solver.kernels.view import view

PAIRS = 4
ROWS, COLUMNS = (0, 1, 1, 1), (1, 0, 1, -1)
"""The pairs' offsets."""

_CIRCLE = 2 * np.pi


@njit(fastmath=True, error_model="numpy")
def _differ(here, there, run, tilts, out):  # type: ignore[no-untyped-def]
    """out ← there − here − the slope's part, modulo 2π; `tilts` are (fall here, fall there, run …)."""
    n, kind = out.size, out.dtype.type
    circle, part, down, right = kind(_CIRCLE), kind(1 / _CIRCLE), kind(0.5 * run[0]), kind(0.5 * run[1])
    fall0, fall1, run0, run1 = tilts
    for j in range(n):
        d = there[j] - here[j] - down * (fall0[j] + fall1[j]) - right * (run0[j] + run1[j])
        out[j] = d - circle * np.rint(d * part)


@njit(fastmath=True)
def _subtract(here, there, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = there[j] - here[j]


@njit(fastmath=True, error_model="numpy")
def _shine(i, n, z, lights):  # type: ignore[no-untyped-def]
    """Row i's |Z|² and |Z|^¼, in (2, 2, n + 4), a ring of two rows."""
    a, b = view(z, (0, i + 2), 0, n + 4), view(z, (1, i + 2), 0, n + 4)
    power, root = view(lights, (i & 1, 0), 0, n + 4), view(lights, (i & 1, 1), 0, n + 4)
    for j in range(n + 4):
        q = a[j] * a[j] + b[j] * b[j]
        power[j] = q
        root[j] = np.sqrt(np.sqrt(np.sqrt(q)))


@njit(fastmath=True, error_model="numpy")
def _ease(i, k, lights, loose, change, law, out):  # type: ignore[no-untyped-def]
    """out ← loose · (1 + (Δl / e)²) / |Z|^¼, the second factor less where the darker one is hardly lit."""
    ease, faint, glare = law
    n, c, here, there = out.size, COLUMNS[k], i & 1, i + ROWS[k] & 1
    t0, r0 = view(lights, (here, 0), 2, n), view(lights, (here, 1), 2, n)
    t1, r1 = view(lights, (there, 0), 2 + c, n), view(lights, (there, 1), 2 + c, n)
    one, free = out.dtype.type(1), view(loose, (i + 2,), 2, n)
    for j in range(n):
        low = min(t0[j], t1[j])
        eased = one + ease * change[j] * change[j] * low / (low + faint + glare * max(t0[j], t1[j]))
        out[j] = free[j] * eased / min(r0[j], r1[j])


@njit
def _differences(i, k, state, slope, logs, phases):  # type: ignore[no-untyped-def]
    """Differences of l and φ of the pairs k of a row; where they leave the image on the side, anything."""
    n, r, c = logs.size, ROWS[k], COLUMNS[k]
    a, b = i + 2, i + 2 + r
    _subtract(view(state, (0, a), 2, n), view(state, (0, b), 2 + c, n), logs)
    tilts = (
        view(slope, (0, a), 2, n), view(slope, (0, b), 2 + c, n),
        view(slope, (1, a), 2, n), view(slope, (1, b), 2 + c, n),
    )  # fmt: skip
    _differ(view(state, (1, a), 2, n), view(state, (1, b), 2 + c, n), (r, c), tilts, phases)


@njit
def _end(c, image):  # type: ignore[no-untyped-def]
    """Nothing where a row's pairs leave the image on the side."""
    if c > 0:
        image[image.size - 1] = 0
    elif c < 0:
        image[0] = 0


@njit(fastmath=True, error_model="numpy")
def _strengthen(d, most, square, eased, out):  # type: ignore[no-untyped-def]
    """out ← W of the differences d."""
    for j in range(out.size):
        out[j] = most / ((square + d[j] * d[j]) * eased[j])


@njit(fastmath=True)
def _multiply(a, b, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = a[j] * b[j]


@njit
def _shorten(source, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = shorten(source[j])


@njit
def _weigh(i, rows, state, lights, loose, slope, factors, logs, phases, lines, out):  # type: ignore[no-untyped-def]
    """out (2, 2, 4, n + 4) ← strengths and fluxes W d of l and φ, row i's pairs; 0 beyond the image."""
    n = out.shape[3] - 4
    change, rise, eased, ones = lines
    kind, log_square, square = state.dtype.type, logs[1] * logs[1], phases[1] * phases[1]
    law = kind(phases[2]), kind(phases[3]), kind(phases[4])
    for k in range(PAIRS):
        if i < 0 or i + ROWS[k] >= rows or factors[k] == 0:
            out[:, :, k] = 0
            continue
        _differences(i, k, state, slope, change, rise)
        double = 2 * factors[k]
        _ease(i, k, lights, loose, change, law, eased)
        for c in range(2):
            strength, flux = view(out, (c, 0, k), 2, n), view(out, (c, 1, k), 2, n)
            if c == 0:
                _strengthen(change, kind(double * logs[0]), kind(log_square), ones, strength)
                _end(COLUMNS[k], strength)
                _multiply(strength, change, flux)
            else:
                _strengthen(rise, kind(double * phases[0]), kind(square), eased, strength)
                _end(COLUMNS[k], strength)
                _multiply(strength, rise, flux)


@njit(fastmath=True)
def _gather(c, k, n, own, last, right, diagonal):  # type: ignore[no-untyped-def]
    """right += what flows in, diagonal += what ties, of one row and one kind of pair."""
    other = own if ROWS[k] == 0 else last
    w, back = view(own, (c, 0, k), 2, n), view(other, (c, 0, k), 2 - COLUMNS[k], n)
    for j in range(n):
        diagonal[j] += w[j] + back[j]
    out, inward = view(own, (c, 1, k), 2, n), view(other, (c, 1, k), 2 - COLUMNS[k], n)
    for j in range(n):
        right[j] += out[j] - inward[j]


@njit(fastmath=True, error_model="numpy")
def _finish(i, n, z, pull, bend, factor, right, inverse):  # type: ignore[no-untyped-def]
    """The data term's part, −conj(Z) pull and factor · bend · |Z|²; the diagonal is inverted."""
    a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
    s, t, m = view(pull, (0, i), 2, n), view(pull, (1, i), 2, n), view(bend, (i,), 2, n)
    r0, r1 = view(right, (0, i), 2, n), view(right, (1, i), 2, n)
    d0, d1 = view(inverse, (0, i), 2, n), view(inverse, (1, i), 2, n)
    one = s.dtype.type(1)
    for j in range(n):
        r0[j] -= a[j] * s[j] + b[j] * t[j]
        r1[j] -= a[j] * t[j] - b[j] * s[j]
    for j in range(n):
        own = factor * m[j] * (a[j] * a[j] + b[j] * b[j])
        d0[j] = one / (d0[j] + own)
        d1[j] = one / (d1[j] + own)


@njit(nogil=True, cache=True, error_model="numpy")
def assemble(  # type: ignore[no-untyped-def]
    rank, size, state, z, loose, slope, factors, logs, phases, pull, bend, factor, v, w, right, inverse
):
    """Strengths V, W, the right-hand side and the inverse of the diagonal; by a team.

    Args:
        z: the state's phasors; slope: (2, rows + 4, columns + 4), φ's rise by row and by column.
        loose: (rows + 4, columns + 4), what the penalties of φ are divided by besides.
        factors: (4,) of the pairs; logs, phases: (κ, δ) of l and (κ, δ, 1 / e², faint, glare) of φ: the
            easing is halved where the darker pixel's |Z|² is faint + glare · that of the brighter one.
        pull: the data term's gradient at Z; bend: (rows + 4, columns + 4), its operator's diagonal over
            `factor`.
        v, w: (4, rows + 4, columns + 4) ←; right, inverse: (2, rows + 4, columns + 4) ← .
    """
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype
    lines = np.empty(n, kind), np.empty(n, kind), np.empty(n, kind), np.ones(n, kind)
    both, lights = np.zeros((2, 2, 2, PAIRS, n + 4), kind), np.zeros((2, 2, n + 4), kind)
    top, end = rank * rows // size, (rank + 1) * rows // size
    _shine(top - 1, n, z, lights)
    for row in range(top - 1, end):
        own, last = both[row & 1], both[1 - row & 1]
        _shine(row + 1, n, z, lights)
        _weigh(row, rows, state, lights, loose, slope, factors, logs, phases, lines, own)
        if row < top:
            continue
        i = row + 2
        for k in range(PAIRS):
            _shorten(view(own, (0, 0, k), 2, n), view(v, (k, i), 2, n))
            _shorten(view(own, (1, 0, k), 2, n), view(w, (k, i), 2, n))
        for c in range(2):
            target, diagonal = view(right, (c, i), 2, n), view(inverse, (c, i), 2, n)
            target[:] = 0
            diagonal[:] = 0
            for k in range(PAIRS):
                _gather(c, k, n, own, last, target, diagonal)
        _finish(i, n, z, pull, bend, factor, right, inverse)


@njit(fastmath=True)
def pull(i, n, c, x, strengths, out):  # type: ignore[no-untyped-def]
    """out += Gᵀ W G x in row i of channel c; the row counts from the padding's first."""
    target, up, here, down = view(out, (c, i), 2, n), (c, i - 1), (c, i), (c, i + 1)
    x0, xl, xr = view(x, here, 2, n), view(x, here, 1, n), view(x, here, 3, n)
    xu, xd = view(x, up, 2, n), view(x, down, 2, n)
    r, l = view(strengths, (0, i), 2, n), view(strengths, (0, i), 1, n)  # noqa: E741
    d, u = view(strengths, (1, i), 2, n), view(strengths, (1, i - 1), 2, n)
    for j in range(n):
        v = x0[j]
        along = lengthen(r[j]) * (v - xr[j]) + lengthen(l[j]) * (v - xl[j])
        target[j] += along + lengthen(d[j]) * (v - xd[j]) + lengthen(u[j]) * (v - xu[j])
    xa, xb, xc, xe = view(x, down, 3, n), view(x, up, 1, n), view(x, down, 1, n), view(x, up, 3, n)
    a, b = view(strengths, (2, i), 2, n), view(strengths, (2, i - 1), 1, n)
    s, e = view(strengths, (3, i), 2, n), view(strengths, (3, i - 1), 3, n)
    for j in range(n):
        v = x0[j]
        falling = lengthen(a[j]) * (v - xa[j]) + lengthen(b[j]) * (v - xb[j])
        target[j] += falling + lengthen(s[j]) * (v - xc[j]) + lengthen(e[j]) * (v - xe[j])


@njit(fastmath=True, error_model="numpy")
def _costs(d, square, out):  # type: ignore[no-untyped-def]
    one = d.dtype.type(1)
    for j in range(out.size):
        out[j] = logarithm(one + d[j] * d[j] / square)


@njit(nogil=True, cache=True, error_model="numpy")
def cost(rank, size, state, z, loose, slope, factors, logs, phases, sums):  # type: ignore[no-untyped-def]
    """sums ← the penalties of each row's pairs; by a team.

    Args:
        state: (2, rows + 4, columns + 4), as in `assemble`.
        z: (2, rows + 4, columns + 4), the phasors.
        loose: (rows + 4, columns + 4), padded by 2, what the penalties of φ are divided by besides.
        slope: (2, rows + 4, columns + 4), radians per pixel.
        factors: (4,), of the pairs.
        logs: (κ, δ) of l.
        phases: (κ, δ, 1 / e², faint, glare) of φ, as in `assemble`.
        sums: (rows,), in float64.
    """
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype.type
    change, rise, out = np.empty(n, state.dtype), np.empty(n, state.dtype), np.empty(n, state.dtype)
    lights, top = np.zeros((2, 2, n + 4), state.dtype), rank * rows // size
    law = kind(phases[2]), kind(phases[3]), kind(phases[4])
    _shine(top, n, z, lights)
    for i in range(top, (rank + 1) * rows // size):
        _shine(i + 1, n, z, lights)
        sums[i] = 0.0
        for k in range(PAIRS):
            if i + ROWS[k] < rows:
                _differences(i, k, state, slope, change, rise)
                _costs(rise, kind(phases[1] * phases[1]), out)
                _ease(i, k, lights, loose, change, law, rise)
                out /= rise
                _end(COLUMNS[k], out)
                sums[i] += factors[k] * phases[0] * float(out.sum())
                _costs(change, kind(logs[1] * logs[1]), out)
                _end(COLUMNS[k], out)
                sums[i] += factors[k] * logs[0] * float(out.sum())
