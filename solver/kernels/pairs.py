"""Heavy-tailed penalties on pairs of pixels, their quadratic majorants, and the Gauss–Newton right-hand side.

The state is (2, rows + 4, columns + 4): log-amplitude l and phase φ of Z = exp(l + iφ), padded by 2. A pair k
of neighbours (see `kernels.prior.ROWS`, `COLUMNS`) costs

    κ w log(1 + (d / δ)²),    d = their difference, for φ less the slope's part and modulo 2π,

for φ divided by 1 + (Δl / e)²; it lies under ½ W d² + constant with W = 2 κ w / (δ² + d²), so divided.
Strengths and fluxes W d are (6, rows + 4, columns + 4), 0 where a pair leaves the image.
"""

import numpy as np
from numba import njit

from solver.kernels.prior import COLUMNS, ROWS
from solver.kernels.view import view

_TURN = 2 * np.pi


@njit(fastmath=True, error_model="numpy")
def _differ(here, there, run, tilts, out):  # type: ignore[no-untyped-def]
    """out ← there − here − the slope's part, modulo 2π; `tilts` are (fall here, fall there, run …)."""
    n, kind = out.size, out.dtype.type
    turn, part, down, right = kind(_TURN), kind(1 / _TURN), kind(0.5 * run[0]), kind(0.5 * run[1])
    fall0, fall1, run0, run1 = tilts
    for j in range(n):
        d = there[j] - here[j] - down * (fall0[j] + fall1[j]) - right * (run0[j] + run1[j])
        out[j] = d - turn * np.rint(d * part)


@njit(fastmath=True)
def _subtract(here, there, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = there[j] - here[j]


@njit(fastmath=True, error_model="numpy")
def _strengths(d, most, square, out, flux):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        w = most / (square + d[j] * d[j])
        out[j] = w
        flux[j] = w * d[j]


@njit(fastmath=True, error_model="numpy")
def _ease(i, k, z, change, ease, faint, out):  # type: ignore[no-untyped-def]
    """out ← 1 + (Δl / e)², less where the darker one of the two has hardly any light."""
    n, c = out.size, COLUMNS[k]
    a0, b0 = view(z, (0, i + 2), 2, n), view(z, (1, i + 2), 2, n)
    a1, b1 = view(z, (0, i + 2 + ROWS[k]), 2 + c, n), view(z, (1, i + 2 + ROWS[k]), 2 + c, n)
    one = out.dtype.type(1)
    for j in range(n):
        q = min(a0[j] * a0[j] + b0[j] * b0[j], a1[j] * a1[j] + b1[j] * b1[j])
        out[j] = one + ease * change[j] * change[j] * q / (q + faint)


@njit(fastmath=True, error_model="numpy")
def _relax(eased, out, flux):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        part = out.dtype.type(1) / eased[j]
        out[j] *= part
        flux[j] *= part


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
        image[image.size - c :] = 0
    elif c < 0:
        image[:1] = 0


@njit(nogil=True, cache=True, error_model="numpy")
def weigh(rank, size, state, z, slope, factors, logs, phases, v, log_fluxes, w, fluxes):  # type: ignore[no-untyped-def]
    """Strengths V, W and fluxes of every pair; by a team.

    Args:
        slope: (2, rows + 4, columns + 4), φ's rise by row and by column.
        z: the state's phasors.
        factors: (6,) of the pairs; logs, phases: (κ, δ) of l and (κ, δ, 1 / e², faint) of φ, faint being the
            |Z|² of the darker pixel at which the easing is halved.
    """
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype.type
    change, turn, eased = np.empty(n, state.dtype), np.empty(n, state.dtype), np.empty(n, state.dtype)
    log_most, log_square, most, square = logs[0], logs[1] * logs[1], phases[0], phases[1] * phases[1]
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        for k in range(6):
            at = (k, i + 2)
            here = view(v, at, 2, n), view(log_fluxes, at, 2, n), view(w, at, 2, n), view(fluxes, at, 2, n)
            if i + ROWS[k] >= rows or factors[k] == 0:
                for target in here:
                    target[:] = 0
                continue
            _differences(i, k, state, slope, change, turn)
            double = 2 * factors[k]
            _strengths(change, kind(double * log_most), kind(log_square), here[0], here[1])
            _strengths(turn, kind(double * most), kind(square), here[2], here[3])
            _ease(i, k, z, change, kind(phases[2]), kind(phases[3]), eased)
            _relax(eased, here[2], here[3])
            for target in here:
                _end(COLUMNS[k], target)


@njit(fastmath=True, error_model="numpy")
def _costs(d, square, out):  # type: ignore[no-untyped-def]
    one = d.dtype.type(1)
    for j in range(out.size):
        out[j] = np.log(one + d[j] * d[j] / square)


@njit(nogil=True, cache=True, error_model="numpy")
def cost(rank, size, state, z, slope, factors, logs, phases, sums):  # type: ignore[no-untyped-def]
    """sums (rows,) ← the penalties of each row's pairs; arguments as in `weigh`; by a team."""
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype.type
    change, turn, out = np.empty(n, state.dtype), np.empty(n, state.dtype), np.empty(n, state.dtype)
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        sums[i] = 0.0
        for k in range(6):
            if i + ROWS[k] < rows:
                _differences(i, k, state, slope, change, turn)
                _costs(turn, kind(phases[1] * phases[1]), out)
                _ease(i, k, z, change, kind(phases[2]), kind(phases[3]), turn)
                out /= turn
                _end(COLUMNS[k], out)
                sums[i] += factors[k] * phases[0] * float(out.sum())
                _costs(change, kind(logs[1] * logs[1]), out)
                _end(COLUMNS[k], out)
                sums[i] += factors[k] * logs[0] * float(out.sum())


@njit(fastmath=True, error_model="numpy")
def _inform(z, i, bend, weight, stiff, out):  # type: ignore[no-untyped-def]
    n, kind = out.size, out.dtype.type
    a, b, m = view(z, (0, i), 2, n), view(z, (1, i), 2, n), view(bend, (i,), 2, n)
    tiny = kind(1e-12)
    for j in range(n):
        own = weight * m[j] * (a[j] * a[j] + b[j] * b[j])
        root = np.sqrt(own)
        out[j] = root * np.sqrt(root * np.sqrt(stiff[j])) + tiny


@njit(nogil=True, cache=True)
def informed(rank, size, z, bend, weight, strengths, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← (d³ k)^¼, the inverse variance of φ but for a constant; by a team.

    Data of density d hold a sheet of stiffness k. A membrane would vary by log(1 + 4π k / d) / (4π k) at a
    point; with a tilt that is averaged from its surroundings the variance falls faster with d (measured).

    Args:
        bend: (rows + 4, columns + 4), what data say of a constant φ at |Z| = 1, over `weight`.
    """
    rows, n = out.shape
    stiff = np.zeros(n, out.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        stiff[:] = 0
        for k in range(6):
            r, c = ROWS[k], COLUMNS[k]
            own, other = view(strengths, (k, i), 2, n), view(strengths, (k, i - r), 2 - c, n)
            share = out.dtype.type(0.25 * (r * r + c * c))
            for j in range(n):
                stiff[j] += share * (own[j] + other[j])
        _inform(z, i, bend, weight, stiff, out[row])


@njit(fastmath=True)
def _gather(k, i, n, strengths, fluxes, right, diagonal):  # type: ignore[no-untyped-def]
    """right += what flows in, diagonal += what ties, of one row and one kind of pair."""
    r, c = ROWS[k], COLUMNS[k]
    own, other = view(strengths, (k, i), 2, n), view(strengths, (k, i - r), 2 - c, n)
    out, back = view(fluxes, (k, i), 2, n), view(fluxes, (k, i - r), 2 - c, n)
    for j in range(n):
        right[j] += out[j] - back[j]
    for j in range(n):
        diagonal[j] += own[j] + other[j]


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


@njit(nogil=True, cache=True)
def assemble(rank, size, z, pull, bend, factor, logs, phases, right, inverse):  # type: ignore[no-untyped-def]
    """The right-hand side and the inverse of the diagonal; by a team.

    Args:
        pull: the data term's gradient at Z; bend: (rows + 4, columns + 4), the operator's diagonal over
            `factor`.
        logs, phases: (strengths, fluxes).
        right, inverse: (2, rows + 4, columns + 4) ← .
    """
    rows, n = z.shape[1] - 4, z.shape[2] - 4
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        for c in range(2):
            target, diagonal = view(right, (c, i), 2, n), view(inverse, (c, i), 2, n)
            target[:] = 0
            diagonal[:] = 0
            for k in range(6):
                if c == 0:
                    _gather(k, i, n, logs[0], logs[1], target, diagonal)
                else:
                    _gather(k, i, n, phases[0], phases[1], target, diagonal)
        _finish(i, n, z, pull, bend, factor, right, inverse)


@njit(fastmath=True)
def _bounded(state, move, most, least):  # type: ignore[no-untyped-def]
    for j in range(state.size):
        state[j] = max(state[j] + min(max(move[j], -most), most), least)


@njit(nogil=True, cache=True)
def advance(rank, size, x, most, least, state, z):  # type: ignore[no-untyped-def]
    """Move the state by x, at most by `most` (2,), l not below `least`; z ← its phasors; by a team."""
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype.type
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        l, phase = view(state, (0, i), 2, n), view(state, (1, i), 2, n)  # noqa: E741
        _bounded(l, view(x, (0, i), 2, n), kind(most[0]), kind(least))
        _bounded(phase, view(x, (1, i), 2, n), kind(most[1]), kind(-np.inf))
        a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
        for j in range(n):
            a[j] = np.exp(l[j])
        for j in range(n):
            b[j] = a[j] * np.sin(phase[j])
        for j in range(n):
            a[j] *= np.cos(phase[j])
