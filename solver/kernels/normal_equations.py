"""Samples summed into the normal equations of every frame."""

import numpy as np
from numba import njit

from solver.kernels.barrier import take
from solver.kernels.derivatives import differentiate, sum_rotations, sum_shifts
from solver.kernels.edges import STEEP, UNSEEN
from solver.kernels.nodes import PLACES, WITHIN

HUBER = 1.5  # deviations beyond which a residual counts linearly
WEAK = 2.0  # deviations per pixel: where the mosaic is flatter, its slope is mostly noise


@njit(cache=True, fastmath=True, error_model="numpy")
def share_errors(terms, pixel, number, used, width, error2, lines):  # type: ignore[no-untyped-def]
    """Lower the weights of samples that err alike.

    An edge along a row of pixels crosses all of them at the same place, so where a mosaic cannot follow it,
    they all are off by the same displacement, however many they are: together they know it no better than
    that. Of Σ w U_y² = I, what a row tells of a displacement across it, is left I / (1 + (e² + d²) I); e is
    the mosaic's own error, d what the row is off as a whole. So it is with columns and U_x; a sample's weight
    falls by the mean of both, weighted with its slopes squared. Without this a table's edge that spans the
    image displaces the frame whose rows lie along it.

    Args:
        terms: (10, samples), of `sum_frames`; the weights among them are changed.
        pixel: (pixels,), numbers in their image, ascending, `width` a row.
        number: (samples,), which of the pixels they are.
        used: how many samples there are.
        error2: e², pixels².
        lines: (4, the longer side), room for what each row, then each column, tells, and its pull.
    """
    yy, xx, yr, xr, weight = terms[0], terms[2], terms[3], terms[4], terms[6]
    one, least = np.float32(1.0), np.float32(1e-30)
    lines[:] = 0
    i, start = 0, 0
    told = pull = np.float32(0.0)  # of row i, which begins at `start`
    for s in range(used):
        while pixel[number[s] & WITHIN] >= start + width:
            lines[0, i], lines[2, i] = told, pull
            told = pull = np.float32(0.0)
            i, start = i + 1, start + width
        j, w = (pixel[number[s] & WITHIN] - start) & WITHIN, weight[s]
        told += w * yy[s]
        pull += w * yr[s]
        lines[1, j] += w * xx[s]
        lines[3, j] += w * xr[s]
    lines[0, i], lines[2, i] = told, pull
    for h in range(2):
        for i in range(lines.shape[1]):
            away = lines[2 + h, i] / max(lines[h, i], least)
            lines[h, i] = one / (one + (error2 + away * away) * lines[h, i])
    i, start = 0, 0
    for s in range(used):
        while pixel[number[s] & WITHIN] >= start + width:
            i, start = i + 1, start + width
        j = (pixel[number[s] & WITHIN] - start) & WITHIN
        down, across = yy[s], xx[s]
        weight[s] *= (down * lines[0, i] + across * lines[1, j]) / (down + across + least)


@njit(cache=True, fastmath=PLACES)
def _choose(weights, row, column, kind, misfit, grid, terms, fractions, node, number):  # type: ignore[no-untyped-def]
    """The samples where the mosaic is steep, and where between its nodes they lie.

    Their weights, rows and columns, and the misfit there, where it is known, are `terms`; `node` is the one
    above and to the left, in a flat image. Returns how many there are, and how many the mosaic covers.
    """
    rows, columns = kind.shape
    known = len(misfit) > 1
    top, left, scale = grid[0], grid[1], grid[2]
    used = seen = 0
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 1.0 and c >= 1.0 and r < rows - 2 and c < columns - 2):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        what = kind[m, n]
        seen += what != UNSEEN
        if what != STEEP:
            continue
        fractions[0, used], fractions[1, used] = r - np.float32(m), c - np.float32(n)
        terms[6, used], terms[7, used], terms[8, used] = weights[s], row[s], column[s]
        if known:
            terms[9, used] = misfit[m, n]
        node[used] = m * columns + n
        number[used] = s
        used += 1
    return used, seen


@njit(cache=True, fastmath=PLACES)
def _interpolate(values, U, node, number, used, fractions, terms):  # type: ignore[no-untyped-def]
    """Per sample ΣU_y², ΣU_yU_x, ΣU_x², ΣU_y r, ΣU_x r and Σr².

    Slopes are twice those between nodes, sums over the channels, r the residual.
    """
    channels, _, width = U.shape
    one = np.float32(1.0)
    yy, yx, xx, yr, xr, squares = terms[0], terms[1], terms[2], terms[3], terms[4], terms[5]
    down, right = fractions[0], fractions[1]
    terms[:6, :used] = 0
    for h in range(channels):
        first = U[h].reshape(-1)
        upper, lower, last = first[width:], first[2 * width :], first[3 * width :]
        for s in range(used):
            k, a, d = (node[s] - width) & WITHIN, down[s], right[s]
            e, g = one - a, one - d
            up, low = g * upper[k] + d * upper[k + 1], g * lower[k] + d * lower[k + 1]
            gy = e * (low - g * first[k] - d * first[k + 1]) + a * (g * last[k] + d * last[k + 1] - up)
            before, after = e * upper[k - 1] + a * lower[k - 1], e * upper[k + 2] + a * lower[k + 2]
            near, far = e * upper[k] + a * lower[k], e * upper[k + 1] + a * lower[k + 1]
            gx = g * (far - before) + d * (after - near)
            residual = values[number[s] & WITHIN, h] - e * up - a * low
            yy[s] += gy * gy
            yx[s] += gy * gx
            xx[s] += gx * gx
            yr[s] += gy * residual
            xr[s] += gx * residual
            squares[s] += residual * residual


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


@njit(cache=True, nogil=True)
def sum_frames(  # type: ignore[no-untyped-def]
    counter,
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
    block,
    shape,
    alike,
    sums,
    counts,
):
    """Sum the samples of every frame into its normal equations; by a team.

    What is known of the samples that are summed lies in (10, block) `terms`: ΣU_y², ΣU_yU_x, ΣU_x², ΣU_y r,
    ΣU_x r, Σr² over the channels, the weight, row, column and misfit.

    Args:
        counter: (1,), see `kernels.barrier`.
        values: (samples, C), in deviations.
        weights: (samples,), 1 / variance.
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        pixel: (samples,), numbers in their image, ascending in a frame.
        first: (N + 1,), where the samples of each frame begin.
        U: (C, rows, columns), the mosaic, in deviations.
        kind: (rows, columns), of `kernels.edges.classify`.
        misfit: (rows, columns), in variances, or (1, 1) = one everywhere.
        grid: (3,), row and column of the first node in pixels, nodes per pixel.
        camera: (4,), focal lengths and centre in pixels, by row and by column; of a displacement the first
            two are 1.
        rotational: whether the motion is a rotation.
        blur2: the mosaic's own error squared, pixels².
        block: how many samples at a time; where rows and columns share errors, as many as a frame has.
        shape: rows and columns of the samples' image.
        alike: whether the samples of a row or column share errors.
        sums: (N, 15), in place, see `kernels.derivatives`.
        counts: (N, 3), in place: samples seen, trust and misfit.
    """
    height, width = shape
    terms, jacobian = np.ones((10, block), np.float32), np.empty((6, block), np.float32)
    fractions, node = np.empty((2, block), np.float32), np.empty(block, np.int32)
    number, lines = np.empty(block, np.int32), np.empty((4, max(height, width)), np.float32)
    k = take(counter)
    while k < len(sums):
        for start in range(first[k], first[k + 1], block):
            part = slice(start, min(start + block, first[k + 1]))
            place = weights[part], row[part], column[part]
            used, seen = _choose(*place, kind, misfit, grid, terms, fractions, node, number)
            counts[k, 0] += seen
            _interpolate(values[part], U, node, number, used, fractions, terms)
            _weigh(terms, used, grid[2], blur2, counts[k])
            if alike:
                share_errors(terms, pixel[part], number, used, width, blur2, lines)
            if rotational:
                differentiate(terms, used, camera, jacobian)
                sum_rotations(terms, used, jacobian, sums[k])
            else:
                sum_shifts(terms, used, camera, sums[k])
        k = take(counter)
