"""One Gauss–Newton step of every frame against the mosaic."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.mosaic import FLAT, UNSEEN, Mosaic
from solver.registration.motion import Motion
from solver.registration.samples import Samples

Float = NDArray[np.float64]

HUBER = 1.5  # deviations beyond which a residual counts linearly
POSITION_ERROR = 0.05  # pixels; the mosaic's error beside an edge, as a displacement
OBSERVABLE = 1.0  # times what independent noise would add; on a plain wall a mosaic shows half of that
WEAK = 4.0  # deviations per pixel: where the mosaic is flatter, its slope is mostly noise


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
    samples: Samples, positions: NDArray[np.float32], mosaic: Mosaic, motion: Motion, position_error: float
) -> Equations:
    """Linearise y ≈ U(p(θ + δ)) for every frame.

    A residual's variance is σ² + (e |∇U|)², e the mosaic's own error as a displacement: without it a handful
    of strong edges decides. Slopes are central differences: the cells' own would lean towards one node, and a
    frame whose pixels all sit alike on the grid, as the reference's do, would be pulled along.
    """
    sums = _normal_equations(
        samples.values,
        samples.weights,
        positions,
        mosaic.values,
        mosaic.down,
        mosaic.right,
        mosaic.kind,
        np.array(mosaic.grid.origin, dtype=np.float32),
        mosaic.grid.density,
        motion.camera(samples.level).astype(np.float32),
        motion.rotational,
        position_error,
    )
    total, seen, trust, misfit = sums[:, 9:13].T
    return Equations(
        _symmetric(sums[:, :6]),
        _symmetric(sums[:, 13:]) * mosaic.slope_noise,
        sums[:, 6:9],
        seen / np.maximum(total, 1),
        misfit / np.maximum(trust, 1e-9),
    )


def _symmetric(upper: Float) -> Float:
    matrix = np.empty((len(upper), 3, 3))
    row, column = np.triu_indices(3)
    matrix[:, row, column] = upper
    matrix[:, column, row] = upper
    return matrix


@numba.njit(cache=True, parallel=True, fastmath=True)
def _normal_equations(  # type: ignore[no-untyped-def]
    values, weights, positions, U, Uy, Ux, kind, origin, density, camera, rotational, position_error
):
    channels, count, height, width = values.shape
    rows, columns = U.shape[1:]
    sums = np.zeros((count, 19))
    scale, one, two = np.float32(density), np.float32(1.0), np.float32(2.0)
    blur2, weak2 = np.float32(position_error * position_error), np.float32(WEAK * WEAK)
    fy, fx, cy, cx = camera[0], camera[1], camera[2], camera[3]
    for k in numba.prange(count):
        total = np.zeros(19)
        for i in range(height):
            for j in range(width):
                w = weights[k, i, j]
                if w <= 0.0:
                    continue
                total[9] += 1.0
                row, column = positions[k, i, j, 0], positions[k, i, j, 1]
                r, c = (row - origin[0]) * scale, (column - origin[1]) * scale
                if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
                    continue
                m, n = int(r), int(c)
                what = kind[m, n]
                if what == UNSEEN:
                    continue
                total[10] += 1.0
                if what == FLAT:
                    continue
                a, d = r - np.float32(m), c - np.float32(n)
                w00, w01, w10, w11 = (one - a) * (one - d), (one - a) * d, a * (one - d), a * d
                yy = yx = xx = yr = xr = square = np.float32(0.0)
                for h in range(channels):
                    V, Vy, Vx = U[h], Uy[h], Ux[h]
                    u = w00 * V[m, n] + w01 * V[m, n + 1] + w10 * V[m + 1, n] + w11 * V[m + 1, n + 1]
                    gy = w00 * Vy[m, n] + w01 * Vy[m, n + 1] + w10 * Vy[m + 1, n] + w11 * Vy[m + 1, n + 1]
                    gx = w00 * Vx[m, n] + w01 * Vx[m, n + 1] + w10 * Vx[m + 1, n] + w11 * Vx[m + 1, n + 1]
                    residual = values[h, k, i, j] - u
                    yy += gy * gy
                    yx += gy * gx
                    xx += gx * gx
                    yr += gy * residual
                    xr += gx * residual
                    square += residual * residual
                slope = yy + xx
                variance = one / w + blur2 * slope
                deviations = np.sqrt(square / variance)
                trust = slope / (slope + weak2 / w)
                weight = trust / variance
                if deviations > HUBER:
                    weight *= np.float32(HUBER) / deviations
                cut = min(deviations, np.float32(4.0))
                total[11] += trust
                total[12] += trust * cut
                if rotational:
                    # Derivatives of the position by a small turn about x, y and z, the lens left out.
                    x, y = (column - cx) / fx, (row - cy) / fy
                    y0, y1, y2 = -fy * (one + y * y), fy * x * y, fy * x
                    x0, x1, x2 = -fx * x * y, fx * (one + x * x), -fx * y
                else:
                    y0, y1, y2 = fy, np.float32(0.0), np.float32(0.0)
                    x0, x1, x2 = np.float32(0.0), fx, np.float32(0.0)
                total[0] += weight * (yy * y0 * y0 + two * yx * y0 * x0 + xx * x0 * x0)
                total[1] += weight * (yy * y0 * y1 + yx * (y0 * x1 + y1 * x0) + xx * x0 * x1)
                total[2] += weight * (yy * y0 * y2 + yx * (y0 * x2 + y2 * x0) + xx * x0 * x2)
                total[3] += weight * (yy * y1 * y1 + two * yx * y1 * x1 + xx * x1 * x1)
                total[4] += weight * (yy * y1 * y2 + yx * (y1 * x2 + y2 * x1) + xx * x1 * x2)
                total[5] += weight * (yy * y2 * y2 + two * yx * y2 * x2 + xx * x2 * x2)
                # What slopes of noise alone would add, for a variance of one.
                total[13] += weight * (y0 * y0 + x0 * x0)
                total[14] += weight * (y0 * y1 + x0 * x1)
                total[15] += weight * (y0 * y2 + x0 * x2)
                total[16] += weight * (y1 * y1 + x1 * x1)
                total[17] += weight * (y1 * y2 + x1 * x2)
                total[18] += weight * (y2 * y2 + x2 * x2)
                total[6] += weight * (yr * y0 + xr * x0)
                total[7] += weight * (yr * y1 + xr * x1)
                total[8] += weight * (yr * y2 + xr * x2)
        sums[k] = total
    return sums


def solve_steps(equations: Equations, anchor: Float, stiffness: Float, unit: Float) -> tuple[Float, Float]:
    """Steps (N, 3) and covariances (N, 3, 3).

    Along an edge, or on a plain wall, what looks like a slope is the mosaic's noise, and would lead a step
    anywhere. So a direction counts only where the normal matrix exceeds its noise part several times (a
    generalised eigenvalue problem); elsewhere the prior decides.

    Args:
        equations: of the present parameters.
        anchor: (N, 3) prior minus present parameters.
        stiffness: (3,) 1/σ² of the prior.
        unit: (3,) size of each parameter that moves the image by about a pixel.
    """
    scale = unit[:, None] * unit
    matrix, noise = equations.matrix * scale, equations.noise * scale
    small = 1e-9 * np.trace(matrix + noise, axis1=1, axis2=2) + 1e-12
    root = np.linalg.cholesky(noise + small[:, None, None] * np.eye(3))
    inverse = np.linalg.inv(root)
    ratio, vectors = np.linalg.eigh(inverse @ matrix @ inverse.transpose(0, 2, 1))
    seen = (ratio > OBSERVABLE).astype(np.float64)
    axes = root @ vectors
    useful = (axes * (seen * ratio)[:, None]) @ axes.transpose(0, 2, 1)
    pull = (vectors.transpose(0, 2, 1) @ inverse @ (equations.right * unit)[:, :, None])[:, :, 0] * seen
    right = (axes @ pull[:, :, None])[:, :, 0] + anchor * stiffness * unit
    covariance = np.linalg.inv(useful + np.diag(stiffness * unit**2))
    steps = (covariance @ right[:, :, None])[:, :, 0] * unit
    return np.asarray(steps, np.float64), np.asarray(covariance * scale, np.float64)
