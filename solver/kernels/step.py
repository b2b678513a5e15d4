"""The step in the plane of two directions: how the objective bends along them, and the move itself.

Images are padded as in `kernels.prior`; `stiffness` and `up` are that module's.
"""

import numpy as np
from numba import njit, prange


@njit(fastmath=True)
def _add_bends(i, direction, step, stiffness, up, sums):  # type: ignore[no-untyped-def]
    """Add ⟨z, Lz⟩, ⟨z, Ld⟩, ⟨d, Ld⟩ of row i, L the majorant's operator, one channel."""
    n = direction.shape[1] - 4
    a, b = direction[i, 2 : 2 + n], step[i, 2 : 2 + n]
    a0, a4, b0, b4 = direction[i, 3 : 3 + n], direction[i, 4 : 4 + n], step[i, 3 : 3 + n], step[i, 4 : 4 + n]
    a1, a2, a3 = direction[i + 1, 2 : 2 + n], direction[i + 1, 3 : 3 + n], direction[i + 1, 1 : 1 + n]
    b1, b2, b3 = step[i + 1, 2 : 2 + n], step[i + 1, 3 : 3 + n], step[i + 1, 1 : 1 + n]
    a5, b5, slack = direction[i + 2, 2 : 2 + n], step[i + 2, 2 : 2 + n], stiffness[i, 2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    zz = zd = dd = direction.dtype.type(0)
    for j in range(n):
        z, d = a[j], b[j]
        z0, z1, z2, z3, z4, z5 = z - a0[j], z - a1[j], z - a2[j], z - a3[j], z - a4[j], z - a5[j]
        d0, d1, d2, d3, d4, d5 = d - b0[j], d - b1[j], d - b2[j], d - b3[j], d - b4[j], d - b5[j]
        y0, y1, y2, y3, y4, y5 = w0[j] * z0, w1 * z1, w2[j] * z2, w3[j] * z3, w4[j] * z4, w5 * z5
        far = w3[j] * d3 * d3 + w4[j] * d4 * d4 + w5 * d5 * d5
        zz += slack[j] * (y0 * z0 + y1 * z1 + y2 * z2 + y3 * z3 + y4 * z4 + y5 * z5)
        zd += slack[j] * (y0 * d0 + y1 * d1 + y2 * d2 + y3 * d3 + y4 * d4 + y5 * d5)
        dd += slack[j] * (w0[j] * d0 * d0 + w1 * d1 * d1 + w2[j] * d2 * d2 + far)
    sums[0] += zz
    sums[1] += zd
    sums[2] += dd


@njit(fastmath=True)
def _add_products(direction, step, curved_direction, curved_step, sums):  # type: ignore[no-untyped-def]
    """The same of the data term's operator, whose products with both are given."""
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


@njit(parallel=True, cache=True)
def curvatures(direction, step, curved_direction, curved_step, stiffness, up):  # type: ignore[no-untyped-def]
    """(6,) float64: the majorant's and then the data's ⟨z, Hz⟩, ⟨z, Hd⟩, ⟨d, Hd⟩, z direction, d step."""
    channels, rows, n = direction.shape[0], direction.shape[1] - 4, direction.shape[2] - 4
    sums = np.zeros((rows, 6))
    for row in prange(rows):
        i = row + 2
        for c in range(channels):
            _add_bends(i, direction[c], step[c], stiffness, up[max(0, row + 3 - rows)], sums[row])
            _add_products(
                direction[c, i, 2 : 2 + n],
                step[c, i, 2 : 2 + n],
                curved_direction[c, i, 2 : 2 + n],
                curved_step[c, i, 2 : 2 + n],
                sums[row],
            )
    return sums.sum(axis=0)


@njit(parallel=True, fastmath=True, cache=True)
def advance(a, b, x, data, direction, step, curved_direction, curved_step):  # type: ignore[no-untyped-def]
    """step ← a · direction + b · step, which is added to x; the same of their curved ones, added to data."""
    for row in prange(x.shape[1]):
        for c in range(x.shape[0]):
            at, z, d = x[c, row], direction[c, row], step[c, row]
            for j in range(at.size):
                d[j] = a * z[j] + b * d[j]
                at[j] += d[j]
            slope, u, v = data[c, row], curved_direction[c, row], curved_step[c, row]
            for j in range(slope.size):
                v[j] = a * u[j] + b * v[j]
                slope[j] += v[j]
