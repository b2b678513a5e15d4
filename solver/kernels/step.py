"""The step in the plane of two directions: how the objective bends along them, and the move itself.

Images are padded as in `kernels.prior`; `stiffness` and `up` are that module's.
"""

from numba import njit

from solver.kernels.prior import COLUMNS, ROWS, border, inside


@njit(fastmath=True)
def _add_bends(i, direction, step, stiffness, up, sums):  # type: ignore[no-untyped-def]
    """Add ⟨z, Lz⟩, ⟨z, Ld⟩, ⟨d, Ld⟩ of row i, L the majorant's operator, one channel."""
    n = direction.shape[1] - 4
    first, end = inside(n)
    zz = zd = dd = direction.dtype.type(0)
    for t in range(first + n - end):
        j = border(t, first, end)
        for k in range(6):
            down, right = ROWS[k], COLUMNS[k]
            z = direction[i, j + 2] - direction[i + down, j + 2 + right]
            d = step[i, j + 2] - step[i + down, j + 2 + right]
            slack = stiffness[i, j + 2] * up[k, j]
            zz += slack * z * z
            zd += slack * z * d
            dd += slack * d * d
    m, a = end - first, first + 2
    if m > 0:
        z, zr, zr2 = direction[i, a : a + m], direction[i, a + 1 : a + 1 + m], direction[i, a + 2 : a + 2 + m]
        zd1, zg = direction[i + 1, a : a + m], direction[i + 1, a + 1 : a + 1 + m]
        za, zd2 = direction[i + 1, a - 1 : a - 1 + m], direction[i + 2, a : a + m]
        s, sr, sr2 = step[i, a : a + m], step[i, a + 1 : a + 1 + m], step[i, a + 2 : a + 2 + m]
        sd1, sg = step[i + 1, a : a + m], step[i + 1, a + 1 : a + 1 + m]
        sa, sd2, slacks = step[i + 1, a - 1 : a - 1 + m], step[i + 2, a : a + m], stiffness[i, a : a + m]
        w0, w1, w2 = up[0, first], up[1, first], up[2, first]
        w3, w4, w5 = up[3, first], up[4, first], up[5, first]
        for j in range(m):
            v, u = z[j], s[j]
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
def _add_products(direction, step, curved_direction, curved_step, sums):  # type: ignore[no-untyped-def]
    """The same of the data term's operator, whose products with both are given, one row."""
    n = direction.size
    z, d, u, v = direction[:n], step[:n], curved_direction[:n], curved_step[:n]
    zz = zd = dd = direction.dtype.type(0)
    for j in range(n):
        zz += z[j] * u[j]
        zd += d[j] * u[j]
        dd += d[j] * v[j]
    sums[3] += zz
    sums[4] += zd
    sums[5] += dd


@njit(fastmath=True)
def _add_weighted(direction, step, curvature, sums):  # type: ignore[no-untyped-def]
    """The same of a diagonal operator, one row."""
    n = direction.size
    z, d, c = direction[:n], step[:n], curvature[:n]
    zz = zd = dd = direction.dtype.type(0)
    for j in range(n):
        zz += c[j] * z[j] * z[j]
        zd += c[j] * z[j] * d[j]
        dd += c[j] * d[j] * d[j]
    sums[3] += zz
    sums[4] += zd
    sums[5] += dd


@njit
def bends(  # type: ignore[no-untyped-def]
    top, end, direction, step, curvature, diagonal, curved_direction, curved_step, stiffness, up, sums
):
    """sums (rows, 6) in rows top to end ← the majorant's, then the data's ⟨z, Hz⟩, ⟨z, Hd⟩, ⟨d, Hd⟩."""
    channels, rows, n = direction.shape[0], direction.shape[1] - 4, direction.shape[2] - 4
    for row in range(top, end):
        i, out = row + 2, sums[row]
        out[:] = 0
        for c in range(channels):
            _add_bends(i, direction[c], step[c], stiffness, up[max(0, row + 3 - rows)], out)
            z, d = direction[c, i, 2 : 2 + n], step[c, i, 2 : 2 + n]
            if diagonal:
                _add_weighted(z, d, curvature[i, 2 : 2 + n], out)
            else:
                _add_products(z, d, curved_direction[c, i, 2 : 2 + n], curved_step[c, i, 2 : 2 + n], out)


@njit(fastmath=True)
def _advance_row(a, b, direction, step, to):  # type: ignore[no-untyped-def]
    """step ← a · direction + b · step, which is added to `to`; one row."""
    n = to.size
    z, d, out = direction[:n], step[:n], to[:n]
    for j in range(n):
        new = a * z[j] + b * d[j]
        d[j] = new
        out[j] += new


@njit
def advance(  # type: ignore[no-untyped-def]
    top, end, a, b, x, diagonal, data, direction, step, curved_direction, curved_step
):
    """Move the map by a · direction + b · step in rows top to end, and the data's gradient with it."""
    for i in range(top + 2, end + 2):
        for c in range(x.shape[0]):
            _advance_row(a, b, direction[c, i], step[c, i], x[c, i])
            if not diagonal:
                _advance_row(a, b, curved_direction[c, i], curved_step[c, i], data[c, i])
