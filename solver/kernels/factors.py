"""What a factored phasor is moved by, and what is known of it. Images as in `kernels.pairs`."""

import numpy as np
from numba import njit

from solver.kernels.elementary import exponential, sine_cosine
from solver.kernels.view import view


@njit(fastmath=True)
def _bounded(state, move, most, least):  # type: ignore[no-untyped-def]
    for j in range(state.size):
        state[j] = max(state[j] + min(max(move[j], -most), most), least)


@njit(fastmath=True, error_model="numpy")
def _phasors(logs, phases, a, b):  # type: ignore[no-untyped-def]
    for j in range(a.size):
        a[j] = exponential(logs[j])
    for j in range(a.size):
        sine, cosine = sine_cosine(phases[j])
        b[j] = a[j] * sine
        a[j] *= cosine


@njit(fastmath=True)
def _square(phases, nearest, out):  # type: ignore[no-untyped-def]
    kind = out.dtype.type
    circle, part = kind(2 * np.pi), kind(0.5 / np.pi)
    for j in range(out.size):
        phase = phases[j] - circle * np.floor((phases[j] - nearest) * part)
        out[j] = phase * phase


@njit(fastmath=True, error_model="numpy")
def _light(a, b, faint, power, lit):  # type: ignore[no-untyped-def]
    for j in range(power.size):
        q = a[j] * a[j] + b[j] * b[j]
        power[j] = q
        lit[j] = q / (q + faint)


@njit(nogil=True, cache=True)
def advance(rank, size, x, most, least, nearest, faint, state, z, square, power, lit):  # type: ignore[no-untyped-def]
    """Move the state by x, at most by `most` (2,), l not below `least`; by a team.

    z ← its phasors; square (rows + 4, columns + 4) ← φ², φ being taken from `nearest` up to a circle more;
    power (rows + 4, columns + 4) ← |Z|²; lit (rows + 4, columns + 4) ← |Z|² / (|Z|² + faint).
    """
    rows, n, kind = state.shape[1] - 4, state.shape[2] - 4, state.dtype.type
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        l, phase = view(state, (0, i), 2, n), view(state, (1, i), 2, n)  # noqa: E741
        _bounded(l, view(x, (0, i), 2, n), kind(most[0]), kind(least))
        _bounded(phase, view(x, (1, i), 2, n), kind(most[1]), kind(-np.inf))
        _phasors(l, phase, view(z, (0, i), 2, n), view(z, (1, i), 2, n))
        _square(phase, kind(nearest), view(square, (i,), 2, n))
        _light(
            view(z, (0, i), 2, n),
            view(z, (1, i), 2, n),
            kind(faint),
            view(power, (i,), 2, n),
            view(lit, (i,), 2, n),
        )


@njit(fastmath=True, error_model="numpy")
def _inform(z, i, bend, weight, bent, told, least, out):  # type: ignore[no-untyped-def]
    n, kind = out.size, out.dtype.type
    a, b, m = view(z, (0, i), 2, n), view(z, (1, i), 2, n), view(bend, (i,), 2, n)
    one, tiny, unknown = kind(1), kind(1e-30), kind(np.pi**2 / 3)
    for j in range(n):
        noise = one / (weight * m[j] * (a[j] * a[j] + b[j] * b[j]) + tiny)
        root = np.sqrt(noise)
        lost = told[j] * root * np.sqrt(root * np.sqrt(bent[j])) + least
        out[j] = one / min(lost, unknown)


@njit(nogil=True, cache=True)
def informed(rank, size, z, bend, weight, bent, told, least, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← the inverse variance of φ, the bias counted in; by a team.

    The variance is told · noise^¾ · bent^¼ + least. What nothing is known of may be any angle, of variance
    π² / 3.

    Args:
        z: (2, rows + 4, columns + 4), the phasors.
        bend: (rows + 4, columns + 4), padded by 2, what data say of a constant φ at |Z| = 1, over `weight`.
        weight: a number.
        bent: (rows, columns), radian², the squared second differences of slopes around.
        told: (rows, columns), a factor, the larger the further samples and map are apart.
        least: radian².
        out: (rows, columns), 1 / radian².
    """
    rows = len(out)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        _inform(z, row + 2, bend, weight, bent[row], told[row], least, out[row])
