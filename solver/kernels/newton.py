"""Conjugate gradients on the Gauss–Newton normal equations of a factored phasor, by a team.

The unknown x = l + iφ (channels: log-amplitude, phase) changes Z to Z exp x. Its normal operator is

    H x = conj(Z) · s Bᵀ M B (Z x) + (Gᵀ V G l, Gᵀ W G φ)

with the footprint's stencil M (see `kernels.footprint`), s a factor, and differences G weighed pair by pair
(see `kernels.ties`). Images are (2, rows + 4, columns + 4), padded by 2.
"""

import numpy as np
from numba import njit

from solver.kernels.blur import apply, rings
from solver.kernels.team import meet
from solver.kernels.ties import pull
from solver.kernels.view import view

STRIP = 8
"""Rows done at a time, few enough to stay in cache."""


@njit(fastmath=True)
def _turn(a, b, xr, xi, out, i, n):  # type: ignore[no-untyped-def]
    """out ← Z x of one row."""
    u, v = view(out, (0, i), 2, n), view(out, (1, i), 2, n)
    for j in range(n):
        u[j] = a[j] * xr[j] - b[j] * xi[j]
    for j in range(n):
        v[j] = a[j] * xi[j] + b[j] * xr[j]


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
def _aim(c, i, n, residual, inverse, beta, p):  # type: ignore[no-untyped-def]
    """p ← residual / diagonal + β p of one row."""
    r, d, out = view(residual, (c, i), 2, n), view(inverse, (c, i), 2, n), view(p, (c, i), 2, n)
    for j in range(n):
        out[j] = r[j] * d[j] + beta * out[j]


@njit(fastmath=True)
def _dot(c, i, n, first, second):  # type: ignore[no-untyped-def]
    a, b, total = view(first, (c, i), 2, n), view(second, (c, i), 2, n), first.dtype.type(0)
    for j in range(n):
        total += a[j] * b[j]
    return float(total)


@njit(fastmath=True)
def _step(c, i, n, alpha, p, h, x, residual, inverse):  # type: ignore[no-untyped-def]
    """Move x and the residual of one row; the residual's preconditioned square."""
    q, g, d = view(p, (c, i), 2, n), view(h, (c, i), 2, n), view(inverse, (c, i), 2, n)
    y, r, total = view(x, (c, i), 2, n), view(residual, (c, i), 2, n), p.dtype.type(0)
    for j in range(n):
        y[j] += alpha * q[j]
        s = r[j] - alpha * g[j]
        r[j] = s
        total += s * s * d[j]
    return float(total)


@njit
def _total(sums):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(sums.size):
        total += sums[i]
    return total


@njit(nogil=True, cache=True)
def descend(  # type: ignore[no-untyped-def]
    rank, size, barrier, rounds, least, z, footprint, factor, v, w, inverse, residual, x, work, sums, done
):
    """Up to `rounds` iterations on H x = residual from x = 0; both are changed.

    Args:
        least: part of the residual's preconditioned square at which it is solved.
        z: the phasors; footprint: (stencil, taps, size of them); factor: s.
        v, w: strengths (6, rows + 4, columns + 4) of the pairs, V and W; inverse: of the diagonal of H.
        work: three images (p, Z p, H p); sums: (2, rows); done: (1,) ← the iterations.
    """
    p, q, h = work
    stencil, taps, reach = footprint
    rows, n = x.shape[1] - 4, x.shape[2] - 4
    top, end = rank * rows // size, (rank + 1) * rows // size
    kept, none, kind, one = rings(2, n, taps, reach), p[:0], p.dtype.type, np.ones(6, p.dtype)
    for i in range(top, end):
        sums[1, i] = 0.0
        for c in range(2):
            sums[1, i] += _step(c, i + 2, n, kind(0), p, h, x, residual, inverse)
    meet(barrier, size)
    square = first = _total(sums[1])
    beta, number = 0.0, 0
    while number < rounds and square > least * first and square > 0.0:
        for i in range(top, end):
            for c in range(2):
                _aim(c, i + 2, n, residual, inverse, kind(beta), p)
            at = i + 2
            ends = view(p, (0, at), 2, n), view(p, (1, at), 2, n)
            _turn(view(z, (0, at), 2, n), view(z, (1, at), 2, n), ends[0], ends[1], q, at, n)
        meet(barrier, size)
        for start in range(top, end, STRIP):
            stop = min(start + STRIP, end)
            for c in range(2):
                apply(start, stop, c, q, stencil, none, taps, reach, factor, kept, start > top, h)
            for i in range(start, stop):
                _turn_back(i + 2, n, z, h)
            pull(start, stop, 0, p, v, one, h)
            pull(start, stop, 1, p, w, one, h)
            for i in range(start, stop):
                sums[0, i] = _dot(0, i + 2, n, p, h) + _dot(1, i + 2, n, p, h)
        meet(barrier, size)
        alpha = kind(square / _total(sums[0]))
        for i in range(top, end):
            sums[1, i] = 0.0
            for c in range(2):
                sums[1, i] += _step(c, i + 2, n, alpha, p, h, x, residual, inverse)
        meet(barrier, size)
        before, square = square, _total(sums[1])
        beta = square / before
        number += 1
    if rank == 0:
        done[0] = number
