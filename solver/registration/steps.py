"""Gauss–Newton steps, taken only in directions that the frames show."""

import numpy as np
from numpy.typing import NDArray

from solver.registration.equations import Equations

Float = NDArray[np.float64]

OBSERVABLE = 1.0  # times what independent noise would add; on a plain wall a mosaic shows half of that


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
