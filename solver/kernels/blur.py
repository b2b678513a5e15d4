"""The operator of area footprints, Bᵀ M B x − Bᵀ b, by rows (see `kernels.footprint`).

B has the same taps along rows and columns; they are padded to a multiple of four with zeros, so that four are
walked at a time. Rows come and go in rings, so that all that is on the way stays in the cache.
"""

import numpy as np
from numba import njit


@njit(fastmath=True)
def blur_along(source, taps, out):  # type: ignore[no-untyped-def]
    """out[j] = Σ_k taps[k] source[j + k]; source is at least out.size + taps.size − 1 long."""
    n = out.size
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        s0, s1, s2, s3 = source[k : k + n], source[k + 1 :], source[k + 2 :], source[k + 3 :]
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def blur_across(ring, first, step, taps, out):  # type: ignore[no-untyped-def]
    """out = Σ_k taps[k] ring[(first + step · k) modulo its rows], whole rows."""
    n, rows = out.size, ring.shape[0]
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        r = first + step * k
        s0, s1 = ring[r % rows], ring[(r + step) % rows]
        s2, s3 = ring[(r + 2 * step) % rows], ring[(r + 3 * step) % rows]
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def _couple(i, above, y, below, stencil, out):  # type: ignore[no-untyped-def]
    """out = M y at node row i; rows of y carry one zero on either side, the stencil one on the left."""
    n = out.size
    m0, mr, md = stencil[0, i + 1], stencil[1, i + 1], stencil[2, i + 1]
    ma, mb = stencil[3, i + 1], stencil[4, i + 1]
    ud, ua, ub = stencil[2, i], stencil[3, i], stencil[4, i]
    c0, cr, cd, ca, cb = m0[1 : 1 + n], mr[1 : 1 + n], md[1 : 1 + n], ma[1 : 1 + n], mb[1 : 1 + n]
    cl, du, dua, dub = mr[0:n], ud[1 : 1 + n], ua[0:n], ub[2 : 2 + n]
    yl, yc, yr = y[0:n], y[1 : 1 + n], y[2 : 2 + n]
    al, ac, ar = above[0:n], above[1 : 1 + n], above[2 : 2 + n]
    bl, bc, br = below[0:n], below[1 : 1 + n], below[2 : 2 + n]
    for j in range(n):
        value = c0[j] * yc[j] + cr[j] * yr[j] + cl[j] * yl[j]
        value += cd[j] * bc[j] + ca[j] * br[j] + cb[j] * bl[j]
        out[j] = value + du[j] * ac[j] + dua[j] * al[j] + dub[j] * ar[j]


@njit
def rings(columns, taps, size):  # type: ignore[no-untyped-def]
    """What `apply` keeps from one call to the next: rows on their way, for a map of so many columns."""
    padded, nodes = taps.size, columns - size + 1
    along, blurred = np.zeros((padded, nodes), taps.dtype), np.zeros((3, nodes + 2), taps.dtype)
    residual = np.zeros((padded, columns + 2 * padded), taps.dtype)
    return along, blurred, residual, np.zeros((2, columns + 2 * padded), taps.dtype)


@njit(fastmath=True)
def apply(top, end, x, stencil, side, taps, size, factor, on_the_way, resume, out):  # type: ignore[no-untyped-def]
    """out ← factor · Bᵀ (M B x − b) in rows top to end, one channel.

    Args:
        x, out: (rows + 4, columns + 4), padded by 2.
        stencil: (5, nodes + 2, nodes + 2); side: (nodes + 2, nodes + 2), b, or (0, 0) = none; padded by 1.
        taps: padded with zeros to a multiple of four; the first `size` of them count.
        factor: a number of x's type.
        on_the_way, resume: `rings`, and whether they hold what a call that ended at `top` has left.
    """
    rows, columns, padded = x.shape[0] - 4, x.shape[1] - 4, taps.size
    node_rows, nodes = rows - size + 1, columns - size + 1
    along, blurred, residual, lines = on_the_way
    line, across = lines[0], lines[1]
    first = top + 1 if resume else top - size
    ready = top + size if resume else max(0, top - size)
    for q in range(first, end + 1):
        if 0 <= q < node_rows:
            while ready < q + size:
                line[:columns] = x[ready + 2, 2 : 2 + columns]
                blur_along(line, taps, along[ready % padded])
                ready += 1
            blur_across(along, q, 1, taps, blurred[q % 3, 1 : 1 + nodes])
        else:
            blurred[q % 3] = 0
        r = q - 1
        if r <= top - size and not resume:
            continue
        fresh = residual[r % padded, size - 1 : size - 1 + nodes]
        if 0 <= r < node_rows:
            _couple(r, blurred[(r - 1) % 3], blurred[r % 3], blurred[q % 3], stencil, fresh)
            if side.size:
                fresh -= side[r + 1, 1 : 1 + nodes]
        else:
            fresh[:] = 0
        if r >= top:
            # Σ_k taps[k] residual(row r − k); symmetric taps let the columns run forward.
            blur_across(residual, r, -1, taps, across)
            target = out[r + 2, 2 : 2 + columns]
            blur_along(across, taps, target)
            for j in range(columns):
                target[j] *= factor


@njit(nogil=True, cache=True)
def transform(rank, threads, x, stencil, side, taps, size, factor, out):  # type: ignore[no-untyped-def]
    """`apply` to every channel of x (C, …) by a team; side (C, …) or (C, 0, 0)."""
    rows = x.shape[1] - 4
    top, end, own = rank * rows // threads, (rank + 1) * rows // threads, rings(x.shape[2] - 4, taps, size)
    for c in range(x.shape[0]):
        apply(top, end, x[c], stencil, side[c], taps, size, factor, own, False, out[c])


@njit(nogil=True, cache=True)
def blur(rank, threads, x, taps, size, out):  # type: ignore[no-untyped-def]
    """out (C, nodes + 2, nodes + 2) ← B x, padded by 1; by a team."""
    columns, padded = x.shape[2] - 4, taps.size
    node_rows, nodes = x.shape[1] - 4 - size + 1, columns - size + 1
    line, along = np.zeros(columns + padded, x.dtype), np.zeros((padded, nodes), x.dtype)
    top, end = rank * node_rows // threads, (rank + 1) * node_rows // threads
    for c in range(x.shape[0]):
        ready = top
        for q in range(top, end):
            while ready < q + size:
                line[:columns] = x[c, ready + 2, 2 : 2 + columns]
                blur_along(line, taps, along[ready % padded])
                ready += 1
            blur_across(along, q, 1, taps, out[c, q + 1, 1 : 1 + nodes])
