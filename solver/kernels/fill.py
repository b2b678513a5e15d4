"""Smooth filling of unknown pixels."""

from numba import njit


@njit(cache=True)
def relax(values, rows, columns, sweeps, over):  # type: ignore[no-untyped-def]
    """Gauss–Seidel sweeps with over-relaxation of Laplace's equation at the listed pixels, in place."""
    height, width = values.shape
    for _ in range(sweeps):
        for n in range(rows.size):
            i, j = rows[n], columns[n]
            total, count = 0.0, 0
            if i > 0:
                total, count = total + values[i - 1, j], count + 1
            if i + 1 < height:
                total, count = total + values[i + 1, j], count + 1
            if j > 0:
                total, count = total + values[i, j - 1], count + 1
            if j + 1 < width:
                total, count = total + values[i, j + 1], count + 1
            if count:
                values[i, j] += over * (total / count - values[i, j])
