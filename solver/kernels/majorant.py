"""The quadratic that majorises the objective at a map, image by image: its gradient, diagonal and products.

Where `kernels.walk` does an iteration in one walk, these leave what a direction made on several grids needs.
Images are padded as in `kernels.group`.
"""

import numpy as np
from numba import njit

from solver.kernels.group import COLUMNS, ROWS, add_squares, inside, stiffen, weights_at
from solver.kernels.step import bend
from solver.kernels.view import view


@njit(nogil=True, cache=True)
def stiffnesses(rank, size, x, slope, radius, epsilon, weights, out, sums):  # type: ignore[no-untyped-def]
    """Stiffness of the prior's majorant at a map; by a team.

    Args:
        x: (C, rows + 4, columns + 4), the map, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), or (C, 2, 0, 0) = level.
        radius: (rows + 4, columns + 4), λ by pixel, in units of λ.
        epsilon: a number of x's type, ε.
        weights: (6,), the squared weights of the differences.
        out: (rows + 4, columns + 4) ← r / max(‖∇x − s‖, ε), 0 in the padding.
        sums: (rows, ≥ 2) ← by row Σ r ‖∇x − s‖ with rounded corners, and what the rounding hides of it.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    squares, within = np.zeros(n, x.dtype), inside(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i = row + 2
        squares[:] = 0
        sums[row, :2] = 0
        for c in range(channels):
            add_squares(c, i, x, slope, weights_at(row, rows, weights), within, squares)
        stiffen(squares, view(radius, (i,), 2, n), epsilon, view(out, (i,), 2, n), sums[row])


@njit(fastmath=True)
def _add_own(here, there, tilt, stiffness, weights, gradient, diagonal):  # type: ignore[no-untyped-def]
    """Add what the differences from a row's pixels to others pull."""
    for j in range(gradient.size):
        stiff = weights[j] * stiffness[j]
        gradient[j] += stiff * (here[j] - there[j] + tilt[j])
        diagonal[j] += stiff


@njit(fastmath=True)
def _add_other(here, there, tilt, stiffness, weight, gradient, diagonal):  # type: ignore[no-untyped-def]
    """Add what the differences from other pixels to a row's pull."""
    for j in range(gradient.size):
        stiff = weight * stiffness[j]
        gradient[j] += stiff * (here[j] - there[j] - tilt[j])
        diagonal[j] += stiff


@njit(fastmath=True)
def _tilt(slope, c, i, first, down, right, out):  # type: ignore[no-untyped-def]
    """out ← what the slope foretells for a row's differences, 0 where it is level."""
    if slope.shape[2] == 0:
        return
    fall, run = view(slope, (c, 0, i), first, out.size), view(slope, (c, 1, i), first, out.size)
    for j in range(out.size):
        out[j] = down * fall[j] + right * run[j]


@njit(nogil=True, cache=True)
def gradients(rank, size, x, slope, stiffness, weights, tables, data, curvature, out, diagonal):  # type: ignore[no-untyped-def]
    """The objective's gradient at a map and the diagonal of its majorant; by a team.

    Args:
        x: (C, rows + 4, columns + 4), the map, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), or (C, 2, 0, 0) = level.
        stiffness: (rows + 4, columns + 4), of `stiffnesses`.
        weights: (6,), the squared weights of the differences.
        tables: (3, 6, columns), the same by column, of `kernels.group.tables`.
        data: (C, rows + 4, columns + 4), the data term's gradient.
        curvature: (rows + 4, columns + 4), what stands for the diagonal of the data term's operator.
        out: (C, rows, columns) ← the gradient.
        diagonal: (rows, columns) ← the majorant's diagonal.
    """
    channels, rows, n, kind = x.shape[0], x.shape[1] - 4, x.shape[2] - 4, x.dtype.type
    tilt = np.zeros(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i, last = row + 2, max(0, row + 3 - rows)
        for c in range(channels):
            target, whole = view(out, (c, row), 0, n), view(diagonal, (row,), 0, n)
            target[:] = view(data, (c, i), 2, n)
            whole[:] = view(curvature, (i,), 2, n)
            here, own = view(x, (c, i), 2, n), view(stiffness, (i,), 2, n)
            for k in range(6):
                down, right = ROWS[k], COLUMNS[k]
                there, kept = view(x, (c, i + down), 2 + right, n), view(tables, (last, k), 0, n)
                _tilt(slope, c, i, 2, kind(down), kind(right), tilt)
                _add_own(here, there, tilt, own, kept, target, whole)
                there, other = (
                    view(x, (c, i - down), 2 - right, n),
                    view(stiffness, (i - down,), 2 - right, n),
                )
                _tilt(slope, c, i - down, 2 - right, kind(down), kind(right), tilt)
                _add_other(here, there, tilt, other, weights[k], target, whole)


@njit(fastmath=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = a.dtype.type(0)
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@njit(nogil=True, cache=True)
def products(  # type: ignore[no-untyped-def]
    rank, size, gradient, data, direction, step, curved, curvature, stiffness, weights, sums
):
    """The products that the step in the plane of two directions depends on; by a team.

    Args:
        gradient: (C, rows, columns), the objective's.
        data: (C, rows + 4, columns + 4), the data term's.
        direction: (C, rows + 4, columns + 4), z.
        step: (C, rows + 4, columns + 4), d.
        curved: (C, rows + 4, columns + 4), H z; (C, 0, columns + 4) = H is diagonal.
        curvature: (rows + 4, columns + 4), its diagonal.
        stiffness: (rows + 4, columns + 4), of `stiffnesses`.
        weights: (6,), the squared weights of the differences.
        sums: (rows, 11), from the third on ← by row the gradient's products with z and d, the data's, and
            those of `kernels.step.bend`.
    """
    channels, rows, n = direction.shape[0], direction.shape[1] - 4, direction.shape[2] - 4
    within = inside(n, direction.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i, out = row + 2, sums[row]
        out[2:6] = 0
        for c in range(channels):
            z, d = view(direction, (c, i), 2, n), view(step, (c, i), 2, n)
            whole, own = view(gradient, (c, row), 0, n), view(data, (c, i), 2, n)
            out[2] += _dot(whole, z)
            out[3] += _dot(whole, d)
            out[4] += _dot(own, z)
            out[5] += _dot(own, d)
        bend(
            row, direction, step, curvature, curved.shape[1] == 0, curved, view(stiffness, (i,), 0, n + 4),
            weights, within, out[6:]
        )  # fmt: skip
