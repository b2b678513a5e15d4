"""Conjugate gradients on the Gauss–Newton normal equations of a factored phasor, by a team.

The unknown x = l + iφ (channels: log-amplitude, phase) changes Z to Z exp x. Its normal operator is

    H x = conj(Z) · s Bᵀ M B (Z x) + (Gᵀ V G l, Gᵀ W G φ)

with the footprint's stencil M (see `kernels.interpolation`), s a factor, and differences G weighed pair by
pair (see `kernels.pairs`). Images are (2, rows + 4, columns + 4), padded by 2.

One walk over the rows does a round: what the last one has found moves a row of x, residual and direction, and
a footprint behind that H is applied. So each image is fetched once. With D the inverse diagonal, h = H p and

    α = pᵀ r / pᵀ h,   β = −(r − α h)ᵀ D h / pᵀ h,

all products of one walk, the new direction D (r − α h) + β p is conjugate to any p before, also to the first
one if that is what the last step of Gauss–Newton has moved Z by: a good guess of what is still to come.
"""

import numpy as np
from numba import njit

from solver.kernels.barrier import meet
from solver.kernels.blur import apply, rings
from solver.kernels.pairs import pull
from solver.kernels.view import view

STRIP = 8
"""Rows done at a time, few enough to stay in cache."""


@njit(fastmath=True)
def _move(i, n, alpha, x, p):  # type: ignore[no-untyped-def]
    """x += α p in one row, which is 0 at first."""
    for c in range(2):
        y, q = view(x, (c, i), 2, n), view(p, (c, i), 2, n)
        for j in range(n):
            y[j] += alpha * q[j]


@njit(fastmath=True)
def _aim(i, n, alpha, beta, part, residual, p, h, inverse):  # type: ignore[no-untyped-def]
    """residual −= α h, p ← part · residual / diagonal + β p in one row."""
    for c in range(2):
        r, q = view(residual, (c, i), 2, n), view(p, (c, i), 2, n)
        g, d = view(h, (c, i), 2, n), view(inverse, (c, i), 2, n)
        for j in range(n):
            s = r[j] - alpha * g[j]
            r[j] = s
            q[j] = part * s * d[j] + beta * q[j]


@njit(fastmath=True)
def _turn(i, n, z, p, out):  # type: ignore[no-untyped-def]
    """out ← Z p of one row, in a ring of rows."""
    at = i % out.shape[1]
    a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
    l, phase = view(p, (0, i), 2, n), view(p, (1, i), 2, n)  # noqa: E741
    u, v = view(out, (0, at), 2, n), view(out, (1, at), 2, n)
    for j in range(n):
        u[j] = a[j] * l[j] - b[j] * phase[j]
    for j in range(n):
        v[j] = a[j] * phase[j] + b[j] * l[j]


@njit(fastmath=True)
def _turn_back(i, n, z, h):  # type: ignore[no-untyped-def]
    """h ← conj(Z) h of one row."""
    a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
    u, v = view(h, (0, i), 2, n), view(h, (1, i), 2, n)
    for j in range(n):
        s, t = u[j], v[j]
        u[j] = a[j] * s + b[j] * t
        v[j] = a[j] * t - b[j] * s


@njit(fastmath=True)
def _products(i, n, p, h, residual, inverse, sums):  # type: ignore[no-untyped-def]
    """sums (4,) ← pᵀ h, pᵀ r, rᵀ D h, hᵀ D h of one row."""
    sums[:] = 0.0
    for c in range(2):
        q, g = view(p, (c, i), 2, n), view(h, (c, i), 2, n)
        r, d = view(residual, (c, i), 2, n), view(inverse, (c, i), 2, n)
        bend = own = mixed = square = p.dtype.type(0)
        for j in range(n):
            f = d[j] * g[j]
            bend += q[j] * g[j]
            own += q[j] * r[j]
            mixed += r[j] * f
            square += f * g[j]
        sums[0] += float(bend)
        sums[1] += float(own)
        sums[2] += float(mixed)
        sums[3] += float(square)


@njit
def _total(sums, k):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(sums.shape[0]):
        total += sums[i, k]
    return total


@njit
def _walk(part, step, operator, residual, x, work, kept, sums):  # type: ignore[no-untyped-def]
    """Move rows low to high by the step (α, β, part), and apply H in rows top to end."""
    top, low, high, end = part
    z, (stencil, taps, reach), factor, v, w, inverse = operator
    p, h, turned = work
    rows, n = x.shape[1] - 4, x.shape[2] - 4
    none, moved = p[:0], max(0, top - reach)
    for start in range(top, end, STRIP):
        stop = min(start + STRIP, end)
        while moved < min(stop + reach, rows):
            at = moved + 2
            if low <= moved < high:
                _move(at, n, step[0], x, p)
                _aim(at, n, *step, residual, p, h, inverse)  # type: ignore[call-arg]
            _turn(at, n, z, p, turned)
            moved += 1
        for c in range(2):
            apply(start, stop, c, turned, stencil, none, taps, reach, factor, kept, start > top, h)
        for i in range(start, stop):
            _turn_back(i + 2, n, z, h)
            pull(i + 2, n, 0, p, v, h)
            pull(i + 2, n, 1, p, w, h)
            _products(i + 2, n, p, h, residual, inverse, view(sums, (i,), 0, 4))


@njit(nogil=True, cache=True)
def descend(  # type: ignore[no-untyped-def]
    rank, size, barrier, rounds, resumed, z, footprint, factor, v, w, inverse, residual, x, work, sums
):
    """`rounds` iterations on H x = residual from x = 0; both are changed.

    Args:
        barrier: (places,), see `kernels.barrier`.
        rounds: a number.
        resumed: whether p holds the first direction; else it holds anything finite.
        z: (2, rows + 4, columns + 4), the phasors.
        footprint: ((5, nodes + 2, nodes + 2), (taps,), size), M, taps and how many of them count.
        factor: s.
        v: (pairs, rows + 4, columns + 4), strengths V, see `kernels.pairs`.
        w: (pairs, rows + 4, columns + 4), strengths W.
        inverse: (2, rows + 4, columns + 4), of the diagonal of H.
        residual: (2, rows + 4, columns + 4), changed.
        x: (2, rows + 4, columns + 4), log-amplitude and radians ←.
        work: two of (2, rows + 4, columns + 4), p and H p, finite.
        sums: (rows, 4), room.
    """
    p, h = work
    _, taps, reach = footprint
    rows, n, kind = x.shape[1] - 4, x.shape[2] - 4, p.dtype.type
    top, end = rank * rows // size, (rank + 1) * rows // size
    # What the neighbours read too is moved before all walk.
    low = top if rank == 0 else min(top + reach, end)
    high = end if rank == size - 1 else max(end - reach, low)
    kept = rings(2, n, taps, reach)
    # Taps that are zero may read one number beyond the padding: behind the last row there would be no image.
    turned = np.zeros((2, STRIP + 2 * reach + 2, n + 5), p.dtype)
    step = kind(0), kind(resumed), kind(not resumed)
    for _ in range(rounds):
        for i in range(top, end):
            if not low <= i < high:
                _move(i + 2, n, step[0], x, p)
                _aim(i + 2, n, *step, residual, p, h, inverse)
        meet(barrier, size)
        operator = z, footprint, factor, v, w, inverse
        _walk((top, low, high, end), step, operator, residual, x, (p, h, turned), kept, sums)
        meet(barrier, size)
        bend = _total(sums, 0)
        if bend <= 0.0:
            step = kind(0), kind(0), kind(1)
        else:
            alpha = _total(sums, 1) / bend
            step = kind(alpha), kind((alpha * _total(sums, 3) - _total(sums, 2)) / bend), kind(1)
    for i in range(top, end):
        _move(i + 2, n, step[0], x, p)
