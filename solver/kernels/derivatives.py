"""What samples tell of a motion's parameters; `terms` and `sums` are those of `kernels.normal_equations`."""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True)
def sum_shifts(terms, used, camera, sums):  # type: ignore[no-untyped-def]
    """Add samples to the normal equations of a displacement.

    Args:
        terms: (10, samples), of `normal_equations.sum_frames`.
        used: how many samples there are.
        camera: (4,), focal lengths and centre in pixels, by row and by column; of a displacement the first
            two are 1.
        sums: (15,), a frame's normal equations: matrix, right side, the matrix that noise alone adds.
    """
    yy, yx, xx = terms[0, :used], terms[1, :used], terms[2, :used]
    yr, xr, weight = terms[3, :used], terms[4, :used], terms[6, :used]
    a = b = c = d = e = total = np.float32(0.0)
    for s in range(used):
        w = weight[s]
        a += w * yy[s]
        b += w * yx[s]
        c += w * xx[s]
        d += w * yr[s]
        e += w * xr[s]
        total += w
    fy, fx = camera[0], camera[1]
    sums[0] += fy * fy * a
    sums[1] += fy * fx * b
    sums[3] += fx * fx * c
    sums[6] += fy * d
    sums[7] += fx * e
    # What slopes of noise alone would add, for a variance of one.
    sums[9] += fy * fy * total
    sums[12] += fx * fx * total


@njit(cache=True, fastmath=True, error_model="numpy")
def differentiate(terms, used, camera, jacobian):  # type: ignore[no-untyped-def]
    """Derivatives of row, then column, by a small rotation about x, y and z, the lens left out.

    Args:
        terms: (10, samples), of `normal_equations.sum_frames`.
        used: how many samples there are.
        camera: (4,), focal lengths and centre in pixels, by row and by column; of a displacement the first
            two are 1.
        jacobian: (6, samples), in pixels per radian ←.
    """
    fy, fx, cy, cx, one = camera[0], camera[1], camera[2], camera[3], np.float32(1.0)
    row, column = terms[7, :used], terms[8, :used]
    y0, y1, y2 = jacobian[0, :used], jacobian[1, :used], jacobian[2, :used]
    x0, x1, x2 = jacobian[3, :used], jacobian[4, :used], jacobian[5, :used]
    for s in range(used):
        x, y = (column[s] - cx) / fx, (row[s] - cy) / fy
        y0[s], y1[s], y2[s] = -fy * (one + y * y), fy * x * y, fy * x
        x0[s], x1[s], x2[s] = -fx * x * y, fx * (one + x * x), -fx * y


@njit(cache=True, fastmath=True)
def sum_rotations(terms, used, jacobian, sums):  # type: ignore[no-untyped-def]
    """Add samples, differentiated, to the normal equations of a rotation.

    Args:
        terms: (10, samples), of `normal_equations.sum_frames`.
        used: how many samples there are.
        jacobian: (6, samples), of `differentiate`.
        sums: (15,), as in `sum_shifts`.
    """
    yy, yx, xx = terms[0, :used], terms[1, :used], terms[2, :used]
    yr, xr, weight = terms[3, :used], terms[4, :used], terms[6, :used]
    upper = 0
    for a in range(3):
        ya, xa, right = jacobian[a, :used], jacobian[3 + a, :used], np.float32(0.0)
        for s in range(used):
            right += weight[s] * (yr[s] * ya[s] + xr[s] * xa[s])
        sums[6 + a] += right
        for b in range(a, 3):
            yb, xb = jacobian[b, :used], jacobian[3 + b, :used]
            matrix = noise = np.float32(0.0)
            for s in range(used):
                w, down, across = weight[s], yy[s] * yb[s] + yx[s] * xb[s], yx[s] * yb[s] + xx[s] * xb[s]
                matrix += w * (ya[s] * down + xa[s] * across)
                # What slopes of noise alone would add, for a variance of one.
                noise += w * (ya[s] * yb[s] + xa[s] * xb[s])
            sums[upper] += matrix
            sums[9 + upper] += noise
            upper += 1
