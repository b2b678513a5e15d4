"""Gauss–Newton steps, taken only in directions that the frames show."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.equations import Equations

Float = NDArray[np.float64]

OBSERVABLE = 1.0  # times what independent noise would add; on a plain wall a mosaic shows half of that
SWEEPS = 6  # of Jacobi's rotations: each squares what is left beside the diagonal


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
    steps, covariance = np.empty_like(equations.right), np.empty_like(equations.matrix)
    _solve(equations.matrix, equations.noise, equations.right, anchor, stiffness, unit, steps, covariance)
    return steps, covariance


@numba.njit(cache=True)
def _solve(matrices, noises, rights, anchors, stiffness, unit, steps, covariances):  # type: ignore[no-untyped-def]
    """NumPy's calls on a few 3 × 3 matrices take a third of a millisecond."""
    scale = np.outer(unit, unit)
    for k in range(len(matrices)):
        matrix, noise = matrices[k] * scale, noises[k] * scale
        small = 1e-9 * (np.trace(matrix) + np.trace(noise)) + 1e-12
        root = _cholesky(noise + small * np.eye(3))
        inverse = _inverse(root)
        ratio, vectors = _eigen(_product(_product(inverse, matrix), inverse.T))
        axes, back = _product(root, vectors), _product(vectors.T, inverse)
        useful = np.diag(stiffness * unit * unit)
        right = anchors[k] * stiffness * unit
        for e in range(3):
            if ratio[e] > OBSERVABLE:
                useful += ratio[e] * np.outer(axes[:, e], axes[:, e])
                right += (back[e] * rights[k] * unit).sum() * axes[:, e]
        covariance = _inverse(useful)
        for a in range(3):
            steps[k, a] = (covariance[a] * right).sum() * unit[a]
        covariances[k] = covariance * scale


@numba.njit(cache=True)
def _product(A, B):  # type: ignore[no-untyped-def]
    C = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            C[a, b] = A[a, 0] * B[0, b] + A[a, 1] * B[1, b] + A[a, 2] * B[2, b]
    return C


@numba.njit(cache=True)
def _inverse(A):  # type: ignore[no-untyped-def]
    """By cofactors."""
    C = np.empty((3, 3))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for d in range(3):
            e, f = (d + 1) % 3, (d + 2) % 3
            C[d, a] = A[b, e] * A[c, f] - A[b, f] * A[c, e]
    return C / (A[0, 0] * C[0, 0] + A[0, 1] * C[1, 0] + A[0, 2] * C[2, 0])


@numba.njit(cache=True)
def _cholesky(A):  # type: ignore[no-untyped-def]
    L = np.zeros((3, 3))
    for a in range(3):
        for b in range(a + 1):
            rest = A[a, b] - (L[a, :b] * L[b, :b]).sum()
            L[a, b] = np.sqrt(rest) if a == b else rest / L[b, b]
    return L


@numba.njit(cache=True)
def _eigen(A):  # type: ignore[no-untyped-def]
    """Eigenvalues and, as columns, eigenvectors of a symmetric matrix, by Jacobi's rotations."""
    D, V = A.copy(), np.eye(3)
    for _ in range(SWEEPS):
        for p in range(2):
            for q in range(p + 1, 3):
                if D[p, q] == 0.0:
                    continue
                half = 0.5 * (D[q, q] - D[p, p]) / D[p, q]
                t = 1.0 / (abs(half) + np.sqrt(half * half + 1.0)) * (1.0 if half >= 0.0 else -1.0)
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                R = np.eye(3)
                R[p, p], R[q, q], R[p, q], R[q, p] = c, c, s, -s
                D, V = _product(R.T, _product(D, R)), _product(V, R)
    return np.diag(D).copy(), V
