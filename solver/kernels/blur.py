"""The operator of area footprints, Bᵀ M B x − Bᵀ b, by rows (see `kernels.interpolation`).

B has the same taps along rows and columns; they are padded to a multiple of four with zeros, so that four are
walked at a time. Rows come and go in rings, so that all that is on the way stays in the cache.
"""

import numpy as np
from numba import njit

from solver.kernels.view import view


@njit(fastmath=True)
def blur_along(source, row, first, taps, factor, out):  # type: ignore[no-untyped-def]
    """out[j] = factor · Σ_k taps[k] source[(*row, first + j + k)]; reads out.size + taps.size − 1 numbers."""
    n = out.size
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = factor * taps[k], factor * taps[k + 1], factor * taps[k + 2], factor * taps[k + 3]
        s0, s1 = view(source, row, first + k, n), view(source, row, first + k + 1, n)
        s2, s3 = view(source, row, first + k + 2, n), view(source, row, first + k + 3, n)
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def blur_across(c, ring, first, step, taps, out):  # type: ignore[no-untyped-def]
    """out = Σ_k taps[k] ring[c, (first + step · k) modulo its rows], whole rows."""
    n, rows = out.size, ring.shape[1]
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        r = first + step * k
        s0, s1 = view(ring, (c, r % rows), 0, n), view(ring, (c, (r + step) % rows), 0, n)
        s2, s3 = view(ring, (c, (r + 2 * step) % rows), 0, n), view(ring, (c, (r + 3 * step) % rows), 0, n)
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def _couple(c, i, blurred, stencil, out):  # type: ignore[no-untyped-def]
    """out = M y at node row i, y of channel c in a ring of three rows with a zero on either side."""
    n, here, up = out.size, i + 1, i
    last, now, after = (c, (i + 2) % 3), (c, i % 3), (c, (i + 1) % 3)
    c0, cd = view(stencil, (0, here), 1, n), view(stencil, (2, here), 1, n)
    cr, cl = view(stencil, (1, here), 1, n), view(stencil, (1, here), 0, n)
    ca, cb = view(stencil, (3, here), 1, n), view(stencil, (4, here), 1, n)
    du, dua, dub = view(stencil, (2, up), 1, n), view(stencil, (3, up), 0, n), view(stencil, (4, up), 2, n)
    yl, yc, yr = view(blurred, now, 0, n), view(blurred, now, 1, n), view(blurred, now, 2, n)
    al, ac, ar = view(blurred, last, 0, n), view(blurred, last, 1, n), view(blurred, last, 2, n)
    bl, bc, br = view(blurred, after, 0, n), view(blurred, after, 1, n), view(blurred, after, 2, n)
    for j in range(n):
        value = c0[j] * yc[j] + cr[j] * yr[j] + cl[j] * yl[j]
        value += cd[j] * bc[j] + ca[j] * br[j] + cb[j] * bl[j]
        out[j] = value + du[j] * ac[j] + dua[j] * al[j] + dub[j] * ar[j]


@njit(fastmath=True)
def _subtract(side, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] -= side[j]


@njit
def _clear(out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = 0


@njit
def rings(channels, columns, taps, size):  # type: ignore[no-untyped-def]
    """What `apply` keeps from one call to the next: rows on their way, for a map of so many columns."""
    padded, nodes = taps.size, columns - size + 1
    kind, width = taps.dtype, columns + 2 * padded
    along, blurred = np.zeros((channels, padded, nodes), kind), np.zeros((channels, 3, nodes + 2), kind)
    return along, blurred, np.zeros((channels, padded, width), kind), np.zeros(width, kind)


@njit(fastmath=True)
def apply(top, end, c, x, stencil, side, taps, size, factor, on_the_way, resume, out):  # type: ignore[no-untyped-def]
    """out ← factor · Bᵀ (M B x − b) in rows top to end of channel c.

    Args:
        x, out: (C, rows + 4, columns + 4), padded by 2; x may be a ring of the rows that are read, where
            row i of the map is at (i + 2) modulo its rows.
        stencil: (5, nodes + 2, nodes + 2); side: (C, nodes + 2, nodes + 2), b, or (C, 0, 0) = none; padded
            by 1.
        taps: padded with zeros to a multiple of four; the first `size` of them count.
        factor: a number of x's type.
        on_the_way, resume: `rings`, and whether they hold what a call that ended at `top` has left.
    """
    rows, columns, padded = out.shape[1] - 4, out.shape[2] - 4, taps.size
    node_rows, nodes, one = rows - size + 1, columns - size + 1, x.dtype.type(1)
    along, blurred, residual, across = on_the_way
    first = top + 1 if resume else top - size
    ready = top + size if resume else max(0, top - size)
    for q in range(first, end + 1):
        if 0 <= q < node_rows:
            while ready < q + size:
                # Taps that are zero may read beyond the row, into the padding.
                at = (c, (ready + 2) % x.shape[1])
                blur_along(x, at, 2, taps, one, view(along, (c, ready % padded), 0, nodes))
                ready += 1
            blur_across(c, along, q, 1, taps, view(blurred, (c, q % 3), 1, nodes))
        else:
            _clear(view(blurred, (c, q % 3), 0, nodes + 2))
        r = q - 1
        if r <= top - size and not resume:
            continue
        fresh = view(residual, (c, r % padded), size - 1, nodes)
        if 0 <= r < node_rows:
            _couple(c, r, blurred, stencil, fresh)
            if side.size:
                _subtract(view(side, (c, r + 1), 1, nodes), fresh)
        else:
            _clear(fresh)
        if r >= top:
            # Σ_k taps[k] residual(row r − k); symmetric taps let the columns run forward.
            blur_across(c, residual, r, -1, taps, across)
            blur_along(across, (), 0, taps, factor, view(out, (c, r + 2), 2, columns))


@njit(nogil=True, cache=True)
def transform(rank, threads, x, stencil, side, taps, size, factor, out):  # type: ignore[no-untyped-def]
    """out ← factor · Bᵀ (M B x − b), every channel; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        stencil: (5, nodes + 2, nodes + 2), M, padded by 1.
        side: (C, nodes + 2, nodes + 2), b, padded by 1, or (C, 0, 0) = none.
        taps: (a multiple of four,), padded with zeros; the first `size` of them count.
        factor: a number of x's type.
        out: (C, rows + 4, columns + 4), padded by 2.
    """
    rows = x.shape[1] - 4
    top, end = rank * rows // threads, (rank + 1) * rows // threads
    own = rings(x.shape[0], x.shape[2] - 4, taps, size)
    for c in range(x.shape[0]):
        apply(top, end, c, x, stencil, side, taps, size, factor, own, False, out)


@njit(nogil=True, cache=True)
def blur(rank, threads, x, taps, size, out):  # type: ignore[no-untyped-def]
    """out (C, nodes + 2, nodes + 2) ← B x, padded by 1; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        taps: (a multiple of four,), padded with zeros; the first `size` of them count.
        out: (C, nodes + 2, nodes + 2), padded by 1.
    """
    padded, one = taps.size, x.dtype.type(1)
    node_rows, nodes = x.shape[1] - 4 - size + 1, x.shape[2] - 4 - size + 1
    along = np.zeros((1, padded, nodes), x.dtype)
    top, end = rank * node_rows // threads, (rank + 1) * node_rows // threads
    for c in range(x.shape[0]):
        ready = top
        for q in range(top, end):
            while ready < q + size:
                blur_along(x, (c, ready + 2), 2, taps, one, view(along, (0, ready % padded), 0, nodes))
                ready += 1
            blur_across(0, along, q, 1, taps, view(out, (c, q + 1), 1, nodes))
