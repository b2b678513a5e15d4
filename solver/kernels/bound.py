"""The sparse term's dual bound: what the duals leave at unseen pixels goes to seen ones, then the bound.

`weight`, `mean`, `radius` and `dual` are padded by 2 as in `kernels.group`.
"""

import numpy as np
from numba import njit

from solver.kernels.view import view


@njit(cache=True, fastmath=True)
def potential(excess, weight, sweeps):  # type: ignore[no-untyped-def]
    """φ (rows + 2, columns + 2): its differences carry the excess of unseen pixels to the seen ones around.

    Sweeps down and up over the Poisson equation at unseen pixels, φ = 0 at seen ones; within a row the old
    values serve, so that it is walked in vectors. Free at the border, beyond which φ repeats.

    Args:
        excess: (rows, columns), in units of λ.
        weight: (rows + 4, columns + 4), 0 = unseen.
    """
    rows, columns = excess.shape
    phi, line = np.zeros((rows + 2, columns + 2), excess.dtype), np.empty(columns, excess.dtype)
    quarter, none = excess.dtype.type(0.25), excess.dtype.type(0)
    for sweep in range(sweeps):
        for row in range(rows):
            i = row if sweep % 2 == 0 else rows - 1 - row
            above, below = view(phi, (i,), 1, columns), view(phi, (i + 2,), 1, columns)
            left, here = view(phi, (i + 1,), 0, columns), view(phi, (i + 1,), 1, columns)
            right, e = view(phi, (i + 1,), 2, columns), view(excess, (i,), 0, columns)
            w = view(weight, (i + 2,), 2, columns)
            for j in range(columns):
                mean = quarter * (above[j] + below[j] + left[j] + right[j] + e[j])
                line[j] = none if w[j] > 0 else mean
            for j in range(columns):
                here[j] = line[j]
            phi[i + 1, 0], phi[i + 1, columns + 1] = line[0], line[columns - 1]
            if i == 0:
                phi[0] = phi[1]
            if i == rows - 1:
                phi[rows + 1] = phi[rows]
    return phi


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def correct(rank, size, dual, phi, unit, radius):  # type: ignore[no-untyped-def]
    """Take the differences of φ off the unit differences of `dual`, and bring every group into its ball.

    Args:
        dual: (6, rows + 4, columns + 4), one channel's, in units of λ.
        phi: (rows + 2, columns + 2), of `potential`.
        radius: (rows + 4, columns + 4), of the balls, in units of λ.
        unit: (2,), the weights of the differences to the right and down.
    """
    rows, n = phi.shape[0] - 2, phi.shape[1] - 2
    across, along = 1 / unit[0], 1 / unit[1]
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        factor = np.zeros(n, dual.dtype)
        here, right = view(phi, (row + 1,), 1, n), view(phi, (row + 1,), 2, n)
        below = view(phi, (row + 2,), 1, n)
        p0, p1, reach = view(dual, (0, i), 2, n), view(dual, (1, i), 2, n), view(radius, (i,), 2, n)
        # Few arrays a loop, so that the compiler can test that none overlap.
        for j in range(n):
            p0[j] -= across * (here[j] - right[j])
        for j in range(n):
            p1[j] -= along * (here[j] - below[j])
        for k in range(6):
            p = view(dual, (k, i), 2, n)
            for j in range(n):
                factor[j] += p[j] * p[j]
        for j in range(n):
            factor[j] = reach[j] / max(np.sqrt(factor[j]), reach[j])
        for k in range(6):
            p = view(dual, (k, i), 2, n)
            for j in range(n):
                p[j] *= factor[j]


@njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def least(rank, size, linear, weight, mean, low, high, sums):  # type: ignore[no-untyped-def]
    """sums (rows,) ← Σ of the least w (x − m)² + linear · x over x in [low, high], by row in float64.

    The bounds are those of the data: clipping a map to them lowers every term of the objective, so they
    change no minimum, and they keep the sum finite where no sample falls (w = 0). linear (rows, columns).

    Args:
        linear: (rows, columns), the linear part.
        weight: (rows + 4, columns + 4), padded by 2, w in 1 / λ².
        mean: (rows + 4, columns + 4), padded by 2, m in units of λ.
        sums: (rows,), in float64.
    """
    rows, n = linear.shape
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i, total = row + 2, 0.0
        weights, means, slopes = weight[i, 2 : 2 + n], mean[i, 2 : 2 + n], linear[row]
        for j in range(n):
            w, m, z = float(weights[j]), float(means[j]), float(slopes[j])
            bound = low if z > 0 else high
            free = m - z / (2 * w) if w > 0 else bound
            best = min(max(free, low), high)
            total += w * (best - m) * (best - m) + z * best
        sums[row] = total
