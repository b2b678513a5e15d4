"""Compiled loops of the sparse, squared data term under the group prior.

Rows are walked as views with explicit bounds: wrapped or negative indices would stop the compiler from
vectorising. Every loop gives the same bits for any number of threads: threads share out whole rows, and
sums are taken per row and added in order.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_TILE_ROWS = 64
"""Rows walked together: with eight arrays of 704 columns this fills the 2 MiB cache of one core."""


@njit(inline="always", fastmath=True)
def _ascend_row(
    i: int, over: F32, dual: F32, offsets: I64, weights: F32, step: np.float32, squares: F32
) -> None:
    """dual[:, i] ← projection onto ‖·‖₂ ≤ 1 of dual[:, i] + step · ∇over at row i."""
    rows, columns = over.shape
    for j in range(columns):
        squares[j] = np.float32(0)
    for k in range(offsets.shape[0]):
        down, right = offsets[k, 0], offsets[k, 1]
        if i + down >= rows:
            continue
        first, last = max(0, -right), columns - max(0, right)
        if last <= first:
            continue
        scale = step * weights[k]
        own = dual[k, i, first:last]
        here = over[i, first:last]
        there = over[i + down, first + right : last + right]
        norm = squares[first:last]
        for j in range(last - first):
            value = own[j] + scale * (here[j] - there[j])
            own[j] = value
            norm[j] += value * value
    for j in range(columns):
        squares[j] = np.float32(1) / max(np.float32(1), np.sqrt(squares[j]))
    for k in range(offsets.shape[0]):
        own = dual[k, i]
        for j in range(columns):
            own[j] *= squares[j]


@njit(inline="always", fastmath=True)
def _transpose_row(i: int, dual: F32, offsets: I64, weights: F32, out: F32) -> None:
    """out ← (∇ᵀ dual) at row i."""
    columns = out.size
    for j in range(columns):
        out[j] = np.float32(0)
    for k in range(offsets.shape[0]):
        down, right = offsets[k, 0], offsets[k, 1]
        weight = weights[k]
        own = dual[k, i]
        for j in range(columns):
            out[j] += weight * own[j]
        first, last = max(0, -right), columns - max(0, right)
        if i < down or last <= first:
            continue
        above = dual[k, i - down, first:last]
        target = out[first + right : last + right]
        for j in range(last - first):
            target[j] -= weight * above[j]


@njit(fastmath=True)
def _sweep(
    ascend: tuple[int, int],
    descend: tuple[int, int],
    x: F32,
    over: F32,
    dual: F32,
    shrink: F32,
    pull: F32,
    offsets: I64,
    weights: F32,
    tau: np.float32,
    sigma: np.float32,
    buffer: F32,
) -> None:
    """One iteration over some rows: a row of the map moves as soon as the groups that see it have moved."""
    for i in range(min(ascend[0], descend[0]), max(ascend[1], descend[1])):
        if ascend[0] <= i < ascend[1]:
            _ascend_row(i, over, dual, offsets, weights, sigma, buffer)
        if descend[0] <= i < descend[1]:
            _transpose_row(i, dual, offsets, weights, buffer)
            here, ahead, by, toward = x[i], over[i], shrink[i], pull[i]
            for j in range(buffer.size):
                old = here[j]
                new = (old - tau * buffer[j]) * by[j] + toward[j]
                here[j] = new
                ahead[j] = new + new - old


@njit(parallel=True, fastmath=True, cache=True)
def iterate(
    iterations: int,
    x: F32,
    over: F32,
    dual: F32,
    shrink: F32,
    pull: F32,
    offsets: I64,
    weights: F32,
    tau: np.float32,
    sigma: np.float32,
) -> None:
    """Run primal–dual iterations in place, several at a time on tiles of rows that stay in cache.

    A tile first advances as far as its own rows allow (each iteration leaves out `reach` rows more at
    either end); then the wedges between the tiles are filled in. The order of the operations on each pixel
    is that of plain iterations, so the result is the same to the bit.
    """
    rows, columns = x.shape
    reach = 0
    for k in range(offsets.shape[0]):
        reach = max(reach, offsets[k, 0])
    tiles = max(1, rows // _TILE_ROWS)
    depth = max(1, rows // tiles // max(1, 4 * reach))
    done = 0
    while done < iterations:
        now = min(depth, iterations - done)
        for tile in prange(tiles):
            buffer = np.empty(columns, np.float32)
            top, end = tile * rows // tiles, (tile + 1) * rows // tiles
            for t in range(now):
                first = 0 if tile == 0 else top + reach * t
                last = rows if tile == tiles - 1 else end - reach * (t + 1)
                begin = 0 if tile == 0 else first + reach
                _sweep(
                    (first, last), (begin, last),
                    x, over, dual, shrink, pull, offsets, weights, tau, sigma, buffer,
                )  # fmt: skip
        for tile in prange(tiles - 1):
            buffer = np.empty(columns, np.float32)
            seam = (tile + 1) * rows // tiles
            for t in range(now):
                first, last = seam - reach * (t + 1), seam + reach * t
                _sweep(
                    (first, last), (first, last + reach),
                    x, over, dual, shrink, pull, offsets, weights, tau, sigma, buffer,
                )  # fmt: skip
        done += now


@njit(parallel=True, cache=True)
def energies(x: F32, weight: F32, mean: F32, offsets: I64, weights: F32) -> tuple[float, float]:
    """(Σ w (x − m)², Σ ‖∇x‖₂), summed in float64."""
    rows, columns = x.shape
    data = np.zeros(rows)
    prior = np.zeros(rows)
    for i in prange(rows):
        squares = np.zeros(columns)
        for k in range(offsets.shape[0]):
            down, right = offsets[k, 0], offsets[k, 1]
            if i + down >= rows:
                continue
            first, last = max(0, -right), columns - max(0, right)
            for j in range(first, last):
                difference = weights[k] * (float(x[i, j]) - float(x[i + down, j + right]))
                squares[j] += difference * difference
        for j in range(columns):
            residual = float(x[i, j]) - float(mean[i, j])
            data[i] += weight[i, j] * residual * residual
            prior[i] += np.sqrt(squares[j])
    return data.sum(), prior.sum()


@njit(parallel=True, cache=True)
def conjugate(
    dual: F32, weight: F32, mean: F32, low: float, high: float, offsets: I64, weights: F32
) -> float:
    """Σ over pixels of min over x in [low, high] of w (x − m)² + (∇ᵀ dual) x, in float64.

    The bounds are those of the data: clipping a map to them lowers every term of the objective, so they
    change no minimum, and they keep the bound finite where no sample falls (w = 0).
    """
    rows, columns = weight.shape
    sums = np.zeros(rows)
    for i in prange(rows):
        slope = np.zeros(columns)
        for k in range(offsets.shape[0]):
            down, right = offsets[k, 0], offsets[k, 1]
            for j in range(columns):
                slope[j] += weights[k] * dual[k, i, j]
            if i >= down:
                for j in range(max(0, -right), columns - max(0, right)):
                    slope[j + right] -= weights[k] * dual[k, i - down, j]
        for j in range(columns):
            w, m, z = float(weight[i, j]), float(mean[i, j]), slope[j]
            free = m - z / (2 * w) if w > 0 else (low if z > 0 else high)
            best = min(max(free, low), high)
            sums[i] += w * (best - m) ** 2 + z * best
    return float(sums.sum())


@njit(cache=True)
def scatter(distance: F32, positions: F32, weight: F32, total: F32, squares: F64, factor: int) -> None:
    """Add every sample to the fused pixel floor((position + ½) · factor) under its centre."""
    frames, rows, columns = distance.shape
    fine_rows, fine_columns = weight.shape
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                value = distance[k, i, j]
                if np.isnan(value):
                    continue
                u = np.floor((float(positions[k, i, j, 0]) + 0.5) * factor)
                v = np.floor((float(positions[k, i, j, 1]) + 0.5) * factor)
                if 0 <= u < fine_rows and 0 <= v < fine_columns:
                    weight[int(u), int(v)] += np.float32(1)
                    total[int(u), int(v)] += value
                    squares[0] += float(value) * float(value)
