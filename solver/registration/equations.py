"""The normal equations of a Gauss–Newton step of every frame against the mosaic."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.derivatives import differentiate, sum_shifts, sum_turns
from solver.registration.grid import PLACES, Place
from solver.registration.lines import lines_of, share_errors
from solver.registration.mosaic import Mosaic
from solver.registration.motion import Motion
from solver.registration.points import Points
from solver.registration.steepness import STEEP, UNSEEN
from solver.registration.sums import WITHIN

Float = NDArray[np.float64]

HUBER = 1.5  # deviations beyond which a residual counts linearly
POSITION_ERROR = 0.05  # pixels; the mosaic's error beside an edge, as a displacement
BLOCK = 512  # samples at a time, which stay in the nearest cache
WEAK = 2.0  # deviations per pixel: where the mosaic is flatter, its slope is mostly noise


@dataclass(frozen=True, slots=True)
class Equations:
    """Per frame: normal matrix (N, 3, 3), what the mosaic's noise alone adds to it, right side (N, 3).

    `overlap` is the share of the frame's used samples that the mosaic covers; `misfit` the mean residual in
    deviations, each cut at 4, where the mosaic is steep.
    """

    matrix: Float
    noise: Float
    right: Float
    overlap: Float
    misfit: Float


def normal_equations(
    points: Points, place: Place, mosaic: Mosaic, motion: Motion, position_error: float
) -> Equations:
    """Linearise y ≈ U(p(θ + δ)) for every frame.

    A residual's variance is σ² + (e |∇U|)², e the mosaic's own error as a displacement: without it a handful
    of strong edges decides. Slopes are central differences: the cells' own would lean towards one node, and a
    frame whose pixels all sit alike on the grid, as the reference's do, would be pulled along. Of samples
    that are bent, those of a row or column share errors (see `lines`), so that a frame is one block.
    """
    count, bent = len(points.first) - 1, points.bent
    sums, counts = np.zeros((count, 15)), np.zeros((count, 3))
    block = max(1, int(np.diff(points.first).max())) if bent else BLOCK
    terms, jacobian = np.ones((10, block), np.float32), np.empty((6, block), np.float32)
    _sum_frames(
        points.values,
        points.weights,
        *place,
        points.pixel,
        points.first,
        mosaic.values,
        mosaic.kind,
        mosaic.misfit if mosaic.misfit is not None else np.ones((1, 1), np.float32),
        np.array([*mosaic.grid.origin, mosaic.grid.density], dtype=np.float32),
        motion.camera(points.level).astype(np.float32),
        motion.rotational,
        np.float32(position_error**2),
        terms,
        np.empty(block, np.int32),
        jacobian,
        points.shape[1],
        lines_of(points.shape) if bent else np.empty((0, 0), np.float32),
        sums,
        counts,
    )
    seen, trust, misfit = counts.T
    return Equations(
        _symmetric(sums[:, :6]),
        _symmetric(sums[:, 9:]) * mosaic.slope_noise,
        sums[:, 6:9],
        seen / np.maximum(np.diff(points.first), 1),
        misfit / np.maximum(trust, 1e-9),
    )


def _symmetric(upper: Float) -> Float:
    return upper[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


@numba.njit(cache=True)
def _sum_frames(  # type: ignore[no-untyped-def]
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
                sum_turns(terms, used, jacobian, sums[k])
            else:
                sum_shifts(terms, used, camera, sums[k])


@numba.njit(cache=True, fastmath=PLACES)
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


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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
