"""The dual variables of the group prior, six differences a pixel in one group, and ∇ᵀ of them."""

import numpy as np
from numba import njit, prange

from solver.kernels.prior import COLUMNS, ROWS


@njit(parallel=True, fastmath=True, cache=True)
def duals(x, slope, stiffness, up, out):  # type: ignore[no-untyped-def]
    """out (C, 6, rows + 4, columns + 4) ← stiffness · (∇x − slope), every group in its ball."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    for row in prange(rows):
        i, weights = row + 2, np.sqrt(up[max(0, row + 3 - rows)])
        for c in range(channels):
            for k in range(6):
                down, right = ROWS[k], COLUMNS[k]
                here, there = x[c, i, 2 : 2 + n], x[c, i + down, 2 + right : 2 + right + n]
                for j in range(n):
                    difference = here[j] - there[j]
                    if slope.shape[2] > 0:
                        difference += down * slope[c, 0, i, 2 + j] + right * slope[c, 1, i, 2 + j]
                    out[c, k, i, 2 + j] = stiffness[i, 2 + j] * weights[k, j] * difference


@njit(parallel=True, fastmath=True, cache=True)
def transpose(dual, weights, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← ∇ᵀ dual, one channel (6, rows + 4, columns + 4), in out's precision."""
    rows, n = out.shape
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for row in prange(rows):
        i = row + 2
        a0, b0 = dual[0, i, 2 : 2 + n], dual[0, i, 1 : 1 + n]
        a1, b1 = dual[1, i, 2 : 2 + n], dual[1, i - 1, 2 : 2 + n]
        a2, b2 = dual[2, i, 2 : 2 + n], dual[2, i - 1, 1 : 1 + n]
        a3, b3 = dual[3, i, 2 : 2 + n], dual[3, i - 1, 3 : 3 + n]
        a4, b4 = dual[4, i, 2 : 2 + n], dual[4, i, 0:n]
        a5, b5 = dual[5, i, 2 : 2 + n], dual[5, i - 2, 2 : 2 + n]
        for j in range(n):
            slope = w0 * (float(a0[j]) - b0[j]) + w1 * (float(a1[j]) - b1[j])
            slope += w2 * (float(a2[j]) - b2[j]) + w3 * (float(a3[j]) - b3[j])
            out[row, j] = slope + w4 * (float(a4[j]) - b4[j]) + w5 * (float(a5[j]) - b5[j])


@njit(fastmath=True, cache=True)
def divide(spectrum, row, column):  # type: ignore[no-untyped-def]
    """spectrum (rows, columns) ← spectrum / (row + column), 0 at (0, 0)."""
    for i in range(row.size):
        for j in range(column.size):
            spectrum[i, j] /= row[i] + column[j] if i + j > 0 else spectrum.dtype.type(np.inf)


@njit(parallel=True, fastmath=True, cache=True)
def carry(dual, potential, weights):  # type: ignore[no-untyped-def]
    """Take the weighted differences of a potential (rows, columns) off one channel's unit differences."""
    rows, n = potential.shape
    for row in prange(rows):
        here, across, along = potential[row], dual[0, row + 2, 2 : 2 + n], dual[1, row + 2, 2 : 2 + n]
        right, below = here[1:], potential[min(row + 1, rows - 1)]
        for j in range(n - 1):
            across[j] -= weights[0] * (here[j] - right[j])
        for j in range(n):
            along[j] -= weights[1] * (here[j] - below[j])


@njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def extent(dual, radius, weights, tilt):  # type: ignore[no-untyped-def]
    """The largest (‖group‖ / radius)² of all channels' duals, and −⟨duals, slope⟩ in float64."""
    channels, rows, n = dual.shape[0], dual.shape[2] - 4, dual.shape[3] - 4
    most, lift = np.zeros(rows, dual.dtype), np.zeros(rows)
    for row in prange(rows):
        i = row + 2
        square, reach, product = np.zeros(n, dual.dtype), radius[i, 2 : 2 + n], 0.0
        for c in range(channels):
            for k in range(6):
                p = dual[c, k, i, 2 : 2 + n]
                for j in range(n):
                    square[j] += p[j] * p[j]
                if tilt.shape[2] > 0:
                    fall, run = tilt[c, 0, i, 2 : 2 + n], tilt[c, 1, i, 2 : 2 + n]
                    down, right = dual.dtype.type(ROWS[k]), dual.dtype.type(COLUMNS[k])
                    part = dual.dtype.type(0)
                    for j in range(n):
                        part += p[j] * (down * fall[j] + right * run[j])
                    product += float(weights[k]) * float(part)
        largest = dual.dtype.type(0)
        for j in range(n):
            largest = max(largest, square[j] / (reach[j] * reach[j]))
        most[row], lift[row] = largest, product
    return most.max(), lift.sum()


@njit(parallel=True, fastmath=True, cache=True)
def add_scaled(out, pull, curvature, factor):  # type: ignore[no-untyped-def]
    """out (rows, columns) += pull + factor · curvature, both padded by 2; returns its sum in float64."""
    rows, n = out.shape
    sums = np.zeros(rows)
    for row in prange(rows):
        target, a, b = out[row], pull[row + 2, 2 : 2 + n], curvature[row + 2, 2 : 2 + n]
        total = 0.0
        for j in range(n):
            target[j] += a[j] + factor * b[j]
            total += target[j]
        sums[row] = total
    return sums.sum()
