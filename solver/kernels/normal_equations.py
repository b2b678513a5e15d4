"""Samples summed into the normal equations of every frame."""

import numpy as np
from numba import njit

from solver.kernels.derivatives import differentiate, sum_rotations, sum_shifts
from solver.kernels.edges import STEEP, UNSEEN
from solver.kernels.nodes import PLACES, WITHIN

HUBER = 1.5  # deviations beyond which a residual counts linearly
WEAK = 2.0  # deviations per pixel: where the mosaic is flatter, its slope is mostly noise


@njit(cache=True, fastmath=True, error_model="numpy")
def share_errors(terms, pixel, used, width, error2, lines):  # type: ignore[no-untyped-def]
    """Lower the weights of samples that err alike.

    An edge along a row of pixels crosses all of them at the same place, so where a mosaic cannot follow it,
    they all are off by the same displacement, however many they are: together they know it no better than
    that. Of Σ w U_y² = I, what a row tells of a displacement across it, is left I / (1 + (e² + d²) I); e is
    the mosaic's own error, d what the row is off as a whole. So it is with columns and U_x; a sample's weight
    falls by the mean of both, weighted with its slopes squared. Without this a table's edge that spans the
    image displaces the frame whose rows lie along it.

    Args:
        terms: (10, samples), of `normal_equations._interpolate`; the weights among them are changed.
        pixel: (samples,), numbers in their image, `width` a row.
        used: how many samples there are.
        error2: e², pixels².
        lines: (4, the longer side), room for what each row, then each column, tells, and its pull.
    """
    yy, xx, yr, xr, weight = terms[0], terms[2], terms[3], terms[4], terms[6]
    one, least = np.float32(1.0), np.float32(1e-30)
    lines[:] = 0
    for s in range(used):
        i, w = (pixel[s] // width) & WITHIN, weight[s]
        j = (pixel[s] - i * width) & WITHIN
        lines[0, i] += w * yy[s]
        lines[1, j] += w * xx[s]
        lines[2, i] += w * yr[s]
        lines[3, j] += w * xr[s]
    for h in range(2):
        told, pull = lines[h], lines[2 + h]
        for i in range(len(told)):
            away = pull[i] / max(told[i], least)
            told[i] = one / (one + (error2 + away * away) * told[i])
    for s in range(used):
        i = (pixel[s] // width) & WITHIN
        j = (pixel[s] - i * width) & WITHIN
        down, across = yy[s], xx[s]
        weight[s] *= (down * lines[0, i] + across * lines[1, j]) / (down + across + least)


@njit(cache=True, fastmath=PLACES)
def _interpolate(  # type: ignore[no-untyped-def]
    values, weights, row, column, pixel, U, kind, misfit, grid, terms, number, counts
):
    """Per sample where the mosaic is steep: ΣU_y², ΣU_yU_x, ΣU_x², ΣU_y r, ΣU_x r, Σr², w, row and column.

    Then the misfit there, where it is known. Slopes are twice those between nodes, sums over the channels, r
    the residual. Returns how many there are.
    """
    channels, rows, columns = U.shape
    known = len(misfit) > 1
    top, left, scale, one = grid[0], grid[1], grid[2], np.float32(1.0)
    used = 0
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 1.0 and c >= 1.0 and r < rows - 2 and c < columns - 2):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        what = kind[m, n]
        counts[0] += what != UNSEEN
        if what != STEEP:
            continue
        a, d = r - np.float32(m), c - np.float32(n)
        e, g = one - a, one - d
        yy = yx = xx = yr = xr = square = np.float32(0.0)
        for h in range(channels):
            first, upper, lower, last = U[h, m - 1], U[h, m], U[h, m + 1], U[h, m + 2]
            up, low = g * upper[n] + d * upper[n + 1], g * lower[n] + d * lower[n + 1]
            gy = e * (low - g * first[n] - d * first[n + 1]) + a * (g * last[n] + d * last[n + 1] - up)
            before, after = e * upper[n - 1] + a * lower[n - 1], e * upper[n + 2] + a * lower[n + 2]
            near, far = e * upper[n] + a * lower[n], e * upper[n + 1] + a * lower[n + 1]
            gx = g * (far - before) + d * (after - near)
            residual = values[s, h] - e * up - a * low
            yy += gy * gy
            yx += gy * gx
            xx += gx * gx
            yr += gy * residual
            xr += gx * residual
            square += residual * residual
        terms[0, used], terms[1, used], terms[2, used] = yy, yx, xx
        terms[3, used], terms[4, used], terms[5, used] = yr, xr, square
        terms[6, used], terms[7, used], terms[8, used] = weights[s], row[s], column[s]
        if known:
            terms[9, used] = misfit[m, n]
        number[used] = pixel[s]
        used += 1
    return used


@njit(cache=True, fastmath=True, error_model="numpy")
def _weigh(terms, used, density, blur2, counts):  # type: ignore[no-untyped-def]
    """Slopes in pixels, and the weight of each sample in place of 1/σ²."""
    yy, yx, xx = terms[0, :used], terms[1, :used], terms[2, :used]
    yr, xr, squares, weight = terms[3, :used], terms[4, :used], terms[5, :used], terms[6, :used]
    misfit = terms[9, :used]
    half, one, knee = np.float32(0.5) * density, np.float32(1.0), np.float32(HUBER)
    quarter, weak2, most = half * half, np.float32(WEAK * WEAK), np.float32(4.0)
    trusts = misfits = np.float32(0.0)
    for s in range(used):
        yy[s] *= quarter
        yx[s] *= quarter
        xx[s] *= quarter
        yr[s] *= half
        xr[s] *= half
        slope, own = yy[s] + xx[s], one / weight[s]
        variance = own + blur2 * slope
        deviations = np.sqrt(squares[s] / variance)
        trust = slope / (slope + weak2 * own)
        trusts += trust
        misfits += trust * min(deviations, most)
        own *= misfit[s]
        variance = own + blur2 * slope
        deviations = np.sqrt(squares[s] / variance)
        trust = slope / (slope + weak2 * own)
        weight[s] = trust / variance * (knee / max(deviations, knee))
    counts[1] += trusts
    counts[2] += misfits


@njit(cache=True)
def sum_frames(  # type: ignore[no-untyped-def]
    values,
    weights,
    row,
    column,
    pixel,
    first,
    U,
    kind,
    misfit,
    grid,
    camera,
    rotational,
    blur2,
    terms,
    number,
    jacobian,
    width,
    lines,
    sums,
    counts,
):
    """Sum the samples of every frame into its normal equations.

    Args:
        values: (samples, C), in deviations.
        weights: (samples,), 1 / variance.
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        pixel: (samples,), numbers in their image.
        first: (N + 1,), where the samples of each frame begin.
        U: (C, rows, columns), the mosaic, in deviations.
        kind: (rows, columns), of `kernels.edges.classify`.
        misfit: (rows, columns), in variances, or (1, 1) = one everywhere.
        grid: (3,), row and column of the first node in pixels, nodes per pixel.
        camera: (4,), focal lengths and centre in pixels, by row and by column; of a displacement the first
            two are 1.
        rotational: whether the motion is a rotation.
        blur2: the mosaic's own error squared, pixels².
        terms: (10, block), room.
        number: (block,), room.
        jacobian: (6, block), room.
        width: of the samples' image.
        lines: (4, the longer side), room, or (0, 0) = rows and columns do not share errors.
        sums: (N, 15), in place, see `kernels.derivatives`.
        counts: (N, 3), in place: samples seen, trust and misfit.
    """
    block = terms.shape[1]
    for k in range(len(sums)):
        for start in range(first[k], first[k + 1], block):
            part = slice(start, min(start + block, first[k + 1]))
            place = row[part], column[part], pixel[part]
            used = _interpolate(
                values[part], weights[part], *place, U, kind, misfit, grid, terms, number, counts[k]
            )
            _weigh(terms, used, grid[2], blur2, counts[k])
            if lines.size > 0:
                share_errors(terms, number, used, width, blur2, lines)
            if rotational:
                differentiate(terms, used, camera, jacobian)
                sum_rotations(terms, used, jacobian, sums[k])
            else:
                sum_shifts(terms, used, camera, sums[k])
