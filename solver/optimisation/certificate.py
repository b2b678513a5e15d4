"""A lower bound of the least objective, so that "converged" means something.

For E(X) = Σ Ω (y − A X)² + Σ ‖∇X‖₂ (λ = 1), any residual variables r and groups p with ‖p‖₂ ≤ 1, ∇ᵀp = Aᵀr,

    E(X) ≥ Σ r y − Σ r² / (4 Ω)   for every X

(Fenchel duality; Boyd, Vandenberghe, "Convex Optimization", section 5). An iteration's r = 2 Ω (y − A X) and
p meet the equation only in the limit. Here p is corrected by the least change of its unit differences that
meets it, a Poisson equation, and both are then shrunk until every group is in its ball. Sparse samples need
neither: they take any ∇ᵀp where they fall, and bounds of the map pay for what is left elsewhere (see
`kernels.bound`), so each group is brought into its ball alone.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import dual as duals
from solver.runtime import team


def divergence(dual: NDArray[np.floating], weights: NDArray[np.floating]) -> NDArray[np.floating]:
    """∇ᵀ dual without padding, (C, rows, columns), for dual (C, 6, rows + 4, columns + 4)."""
    out = np.empty((len(dual), dual.shape[2] - 4, dual.shape[3] - 4), dual.dtype)
    for channel, variables in enumerate(dual):
        team.share(duals.transpose, variables, weights.astype(np.float64), out[channel])
    return out


def shrinkage(
    dual: NDArray[np.floating],
    radius: NDArray[np.floating],
    weights: NDArray[np.floating],
    excess: NDArray[np.floating],
    tilt: NDArray[np.floating],
) -> tuple[float, float]:
    """The largest factor up to 1 that brings the duals into their balls once ∇ᵀ dual has lost `excess`.

    Also ⟨duals, −slope⟩ before that factor: what a prior of ‖∇X − slope‖ adds to the bound.

    Args:
        dual: (C, 6, rows + 4, columns + 4), every group in its ball; its unit differences are changed.
        radius: (rows + 4, columns + 4), of the balls.
        weights: (6,), the first two (the unit differences) not 0.
        excess: (C, rows, columns), of sum 0 in each channel; overwritten.
        tilt: (C, 2, rows + 4, columns + 4), the slope, or (C, 2, 0, 0).
    """
    for channel, padded in zip(excess, dual, strict=True):
        potential = _poisson(channel, float(weights[1]) ** 2, float(weights[0]) ** 2)
        team.share(duals.carry, padded, potential, weights.astype(dual.dtype))
    sums = np.zeros((2, excess.shape[1]))
    team.share(duals.extent, dual, radius, weights.astype(dual.dtype), tilt, sums)
    return float(1 / np.sqrt(max(1.0, sums[0].max()))), float(sums[1].sum())


def _poisson(source: NDArray[np.floating], down: float, right: float) -> NDArray[np.floating]:
    """φ of (down · L_rows + right · L_columns) φ = source, L the second difference with free ends."""
    rows, columns = source.shape
    row = down * (2 - 2 * np.cos(np.pi * np.arange(rows) / rows))
    column = right * (2 - 2 * np.cos(np.pi * np.arange(columns) / columns))
    spectrum = _cosines(source)
    duals.divide(spectrum, row.astype(source.dtype), column.astype(source.dtype))
    return _cosines(spectrum, inverse=True)


def _cosines(image: NDArray[np.floating], *, inverse: bool = False) -> NDArray[np.floating]:
    """The orthonormal cosine transform of an image (rows, columns), or the inverse one."""
    if image.shape[0] % 2 == 0 and image.shape[1] % 2 == 0:
        return np.asarray(cv2.dct(image, flags=cv2.DCT_INVERSE if inverse else 0), image.dtype)
    # Twice as slow, but OpenCV knows even sizes only.
    from scipy.fft import dctn, idctn  # only here: it takes long to import, and few come here

    return np.asarray((idctn if inverse else dctn)(image, norm="ortho"))
