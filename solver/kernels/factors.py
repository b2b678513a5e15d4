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
def _curve(tilt, measure, i, here, sides, square):  # type: ignore[no-untyped-def]
    """square += the squared second differences of the tilt of row i, in the measure; `here` is that row's."""
    away, (above, below), (line, other) = sides
    n, two = square.size, square.dtype.type(2)
    for axis in range(2):
        own, top, end = (
            view(tilt, (axis, i), 2, n),
            view(tilt, (axis, above), 2, n),
            view(tilt, (axis, below), 2, n),
        )
        upper, lower = view(measure, (above,), 2, n), view(measure, (below,), 2, n)
        for j in range(n):
            line[away + j] = own[j] / here[j]
        line[:away] = line[away]
        line[away + n :] = line[away + n - 1]
        for j in range(n):
            other[j] = top[j] / upper[j] + end[j] / lower[j]
        for j in range(n):
            middle = two * line[away + j]
            v, h = here[j] * (other[j] - middle), here[j] * (line[j] + line[j + 2 * away] - middle)
            square[j] += v * v + h * h


@njit(fastmath=True, error_model="numpy")
def _inform(z, i, bend, loose, weight, law, square, out):  # type: ignore[no-untyped-def]
    n, kind = out.size, out.dtype.type
    a, b, m = view(z, (0, i), 2, n), view(z, (1, i), 2, n), view(bend, (i,), 2, n)
    free = view(loose, (i,), 2, n)
    averaged, power, told, least = law
    one, tiny, unknown = kind(1), kind(1e-30), kind(np.pi**2 / 3)
    for j in range(n):
        noise = averaged / (weight * m[j] * (a[j] * a[j] + b[j] * b[j]) + tiny)
        hidden, seen = power * noise, square[j] + tiny
        lost = (noise + told * min(seen, hidden * hidden / seen)) * free[j] * free[j] + least
        out[j] = one / min(lost, unknown)


@njit(nogil=True, cache=True)
def informed(rank, size, z, bend, loose, weight, tilt, measure, away, scale, law, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← the inverse variance of φ, the bias counted in; by a team.

    Data of density d, averaged over a support of n pixels, leave 1 / (n d). Second differences of the tilt
    that exceed their noise have been followed; what does not is lost in it: of a power x with noise of power
    y in it a filter that passes 1 − y / x of it leaves y² / x, or x where all is noise. Where a prior had to
    give way there is more noise, and more is hidden. What nothing is known of may be any angle, of variance
    π² / 3.

    Args:
        z: (2, rows + 4, columns + 4), the phasors.
        bend: (rows + 4, columns + 4), padded by 2, what data say of a constant φ at |Z| = 1, over `weight`.
        loose: (rows + 4, columns + 4), padded by 2, by how much the prior has given way.
        weight: a number.
        tilt: (2, rows + 4, columns + 4), radians per pixel.
        measure: (rows + 4, columns + 4), in which tilts of one surface are the same.
        away: pixels to where the tilt is compared.
        scale: pixels², of which times the squared second differences of the tilt x is.
        law: (1 / n, y in units of 1 / (n d), part of what is lost that counts, the least variance).
        out: (rows, columns), 1 / radian².
    """
    rows, n = out.shape
    square, other, line = np.zeros(n, out.dtype), np.zeros(n, out.dtype), np.zeros(n + 2 * away, out.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        ends = max(row - away, 0) + 2, min(row + away, rows - 1) + 2
        square[:] = 0
        _curve(tilt, measure, row + 2, view(measure, (row + 2,), 2, n), (away, ends, (line, other)), square)
        square *= scale
        _inform(z, row + 2, bend, loose, weight, law, square, out[row])
