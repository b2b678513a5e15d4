"""The step in the plane of two directions: how the objective bends along them, and the move itself.

Images are padded as in `kernels.group`; `stiffness`, `inside` and weights are that module's.
"""

from numba import njit

from solver.kernels.group import weights_at
from solver.kernels.view import view


@njit(fastmath=True)
def _add_bends(c, i, direction, step, stiffness, own, inside, sums):  # type: ignore[no-untyped-def]
    """Add ⟨z, Lz⟩, ⟨z, Ld⟩, ⟨d, Ld⟩ of row i, L the majorant's operator, one channel."""
    m, a, here, next1, next2 = direction.shape[2] - 4, 2, (c, i), (c, i + 1), (c, i + 2)
    one, two, back = view(inside, (), a + 1, m), view(inside, (), a + 2, m), view(inside, (), a - 1, m)
    zz = zd = dd = direction.dtype.type(0)
    z, zr, zr2 = view(direction, here, a, m), view(direction, here, a + 1, m), view(direction, here, a + 2, m)
    zd1, zg = view(direction, next1, a, m), view(direction, next1, a + 1, m)
    za, zd2 = view(direction, next1, a - 1, m), view(direction, next2, a, m)
    s, sr, sr2 = view(step, here, a, m), view(step, here, a + 1, m), view(step, here, a + 2, m)
    sd1, sg = view(step, next1, a, m), view(step, next1, a + 1, m)
    sa, sd2, slacks = view(step, next1, a - 1, m), view(step, next2, a, m), view(stiffness, (), a, m)
    whole0, w1, whole2, whole3, whole4, w5 = own
    for j in range(m):
        v, u = z[j], s[j]
        w0, w2, w3, w4 = whole0 * one[j], whole2 * one[j], whole3 * back[j], whole4 * two[j]
        z0, z1, z2, z3, z4, z5 = v - zr[j], v - zd1[j], v - zg[j], v - za[j], v - zr2[j], v - zd2[j]
        d0, d1, d2, d3, d4, d5 = u - sr[j], u - sd1[j], u - sg[j], u - sa[j], u - sr2[j], u - sd2[j]
        y0, y1, y2, y3, y4, y5 = w0 * z0, w1 * z1, w2 * z2, w3 * z3, w4 * z4, w5 * z5
        far = w3 * d3 * d3 + w4 * d4 * d4 + w5 * d5 * d5
        zz += slacks[j] * (y0 * z0 + y1 * z1 + y2 * z2 + y3 * z3 + y4 * z4 + y5 * z5)
        zd += slacks[j] * (y0 * d0 + y1 * d1 + y2 * d2 + y3 * d3 + y4 * d4 + y5 * d5)
        dd += slacks[j] * (w0 * d0 * d0 + w1 * d1 * d1 + w2 * d2 * d2 + far)
    sums[0] += zz
    sums[1] += zd
    sums[2] += dd


@njit(fastmath=True)
def _add_products(direction, step, curved, sums):  # type: ignore[no-untyped-def]
    """Add ⟨z, Hz⟩ and ⟨z, Hd⟩ of one row, H the data term's operator, whose product with z is given."""
    zz = zd = direction.dtype.type(0)
    for j in range(direction.size):
        zz += direction[j] * curved[j]
        zd += step[j] * curved[j]
    sums[3] += zz
    sums[4] += zd


@njit(fastmath=True)
def _add_weighted(direction, step, curvature, sums):  # type: ignore[no-untyped-def]
    """The same of a diagonal operator."""
    zz = zd = direction.dtype.type(0)
    for j in range(direction.size):
        curved = curvature[j] * direction[j]
        zz += direction[j] * curved
        zd += step[j] * curved
    sums[3] += zz
    sums[4] += zd


@njit
def bend(row, direction, step, curvature, diagonal, curved, stiffness, weights, inside, sums):  # type: ignore[no-untyped-def]
    """sums (5,) ← of one row, the majorant's ⟨z, Lz⟩, ⟨z, Ld⟩, ⟨d, Ld⟩ and the data's ⟨z, Hz⟩, ⟨z, Hd⟩.

    Args:
        direction, step, curved: (C, …) z, d and, unless H is diagonal, H z.
        stiffness: (columns + 4,), of this row.
    """
    channels, rows, n, i = direction.shape[0], direction.shape[1] - 4, direction.shape[2] - 4, row + 2
    own = weights_at(row, rows, weights)
    for k in range(5):
        sums[k] = 0
    for c in range(channels):
        _add_bends(c, i, direction, step, stiffness, own, inside, sums)
        z, d = view(direction, (c, i), 2, n), view(step, (c, i), 2, n)
        if diagonal:
            _add_weighted(z, d, view(curvature, (i,), 2, n), sums)
        else:
            _add_products(z, d, view(curved, (c, i), 2, n), sums)


@njit(fastmath=True)
def _advance_row(a, b, direction, step, to):  # type: ignore[no-untyped-def]
    """step ← a · direction + b · step, which is added to `to`; one row."""
    for j in range(to.size):
        new = a * direction[j] + b * step[j]
        step[j] = new
        to[j] += new


@njit
def add_move(top, end, by, direction, step, to):  # type: ignore[no-untyped-def]
    """step ← a · direction + b · step, (a, b) = by, which is added to `to`; rows top to end of (C, …)."""
    n = to.shape[2] - 4
    for i in range(top + 2, end + 2):
        for c in range(to.shape[0]):
            at = (c, i)
            _advance_row(by[0], by[1], view(direction, at, 2, n), view(step, at, 2, n), view(to, at, 2, n))
