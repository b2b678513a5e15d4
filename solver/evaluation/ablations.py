"""The paper's ablations: what each choice in `lidarboost` is worth.

    E(X) = Σ_k ρ(T_k W_k (D_k − X)) + λ Σ φ(∇X)

ρ squared or absolute; W_k sparse with the nearest pixel, or dense with D_k interpolated; φ one norm over all
offsets of a pixel, or one norm each; T_k with or without a threshold. Source: Schuon, Theobalt, Davis, Thrun,
CVPR 2009, sections 3 and 4. Written for clarity in NumPy: a fixed number of primal–dual iterations
(Chambolle, Pock, J. Math. Imaging Vis. 40, 2011).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.evaluation.protocol import Trial

Image = NDArray[np.float64]

OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
ITERATIONS = 300


@dataclass(frozen=True, slots=True)
class Variant:
    """One choice of each kind; the paper's are the defaults."""

    name: str
    resampling: Literal["nearest", "interpolated"] = "nearest"
    data: Literal["squared", "absolute"] = "squared"
    norm: Literal["group", "separate"] = "group"


VARIANTS = (
    Variant("lidarboost"),
    Variant("interpolated resampling", resampling="interpolated"),
    Variant("absolute data term", data="absolute"),
    Variant("separate norms", norm="separate"),
)
LAMBDAS = {"squared": (3.0, 7.0, 15.0), "absolute": (0.1, 0.3, 1.0)}
"""Every variant is given the best of these: in units of depth, or a pure number for the absolute term."""


def ablate(
    trial: Trial, variant: Variant, strength: float, upsampling: int, used: NDArray[np.bool_] | None = None
) -> NDArray[np.float32]:
    """Fuse a burst at its true displacements by a variant.

    Args:
        strength: λ in units of depth, as for `lidarboost`; the same number for every variant.
        used: (N, H, W) samples that pass T_k; None = all.
    """
    keep = np.isfinite(trial.distance) if used is None else used & np.isfinite(trial.distance)
    samples = (_sparse if variant.resampling == "nearest" else _dense)(trial, keep, upsampling)
    x = _start(samples)
    bar, dual = x.copy(), np.zeros((len(OFFSETS), *x.shape))
    norm = np.sqrt(sum(4 / (dy * dy + dx * dx) for dy, dx in OFFSETS))
    ratio = strength / 3  # primal steps in units of depth: an edge of the object over a few iterations
    tau, sigma = ratio / norm, 1 / (ratio * norm)
    for _ in range(ITERATIONS):
        for number, offset in enumerate(OFFSETS):
            dual[number] += sigma * _difference(bar, offset)
        size = np.abs(dual) if variant.norm == "separate" else np.sqrt((dual * dual).sum(axis=0))
        dual /= np.maximum(1, size / strength)
        before = x
        inner = x - tau * sum(_adjoint(dual[number], offset) for number, offset in enumerate(OFFSETS))
        x = _squared(samples, inner, tau) if variant.data == "squared" else _absolute(samples, inner, tau)
        bar = 2 * x - before
    return x.astype(np.float32)


def _difference(x: Image, offset: tuple[int, int]) -> Image:
    """(X(u, v) − X(u + l, v + m)) / √(l² + m²), 0 where the neighbour is outside."""
    here, there = _pair(x.shape, offset)
    result = np.zeros_like(x)
    result[here] = (x[here] - x[there]) / np.hypot(*offset)
    return result


def _adjoint(y: Image, offset: tuple[int, int]) -> Image:
    here, there = _pair(y.shape, offset)
    result = np.zeros_like(y)
    result[here] += y[here] / np.hypot(*offset)
    result[there] -= y[here] / np.hypot(*offset)
    return result


def _pair(shape: tuple[int, ...], offset: tuple[int, int]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    here = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(offset, shape, strict=True))
    there = tuple(slice(max(0, d), n + min(0, d)) for d, n in zip(offset, shape, strict=True))
    return here, there


def _sparse(trial: Trial, keep: NDArray[np.bool_], factor: int) -> Image:
    """(N, βH, βW): each sample on the fused pixel under its centre, NaN elsewhere."""
    count, rows, columns = trial.distance.shape
    result = np.full((count, rows * factor, columns * factor), np.nan)
    i, j = np.indices((rows, columns))
    for k, (dy, dx) in enumerate(trial.shifts):
        r = np.floor((i + 0.5 + dy) * factor).astype(int)
        c = np.floor((j + 0.5 + dx) * factor).astype(int)
        inside = keep[k] & (r >= 0) & (c >= 0) & (r < rows * factor) & (c < columns * factor)
        result[k, r[inside], c[inside]] = trial.distance[k][inside]
    return result


def _dense(trial: Trial, keep: NDArray[np.bool_], factor: int) -> Image:
    """(N, βH, βW): every fused pixel takes each frame's bilinear value, NaN outside the frame."""
    from scipy.ndimage import map_coordinates

    count, rows, columns = trial.distance.shape
    i, j = np.indices((rows * factor, columns * factor))
    result = np.empty((count, rows * factor, columns * factor))
    for k, (dy, dx) in enumerate(trial.shifts):
        at = np.stack([(i + 0.5) / factor - 0.5 - dy, (j + 0.5) / factor - 0.5 - dx])
        frame = np.where(keep[k], trial.distance[k], np.nan).astype(np.float64)
        result[k] = map_coordinates(frame, at, order=1, cval=np.nan)
    return result


def _start(samples: Image) -> Image:
    from solver.optimisation.fill import nearest

    count = np.isfinite(samples).sum(axis=0)
    mean = np.nansum(samples, axis=0) / np.maximum(count, 1)
    return nearest(mean.astype(np.float32), count > 0).astype(np.float64)


def _squared(samples: Image, v: Image, tau: float) -> Image:
    """Proximal map of Σ_k (x − d_k)²."""
    count = np.isfinite(samples).sum(axis=0)
    return np.asarray((v + 2 * tau * np.nansum(samples, axis=0)) / (1 + 2 * tau * count))


def _absolute(samples: Image, v: Image, tau: float) -> Image:
    """Proximal map of Σ_k |x − d_k|: the median of the n samples and the n + 1 points v + τ (n − 2 j).

    Source: Li, Osher, "A new median formula with applications to PDE based denoising", Commun. Math. Sci. 7,
    2009.
    """
    count = np.isfinite(samples).sum(axis=0)
    j = np.arange(len(samples) + 1)[:, None, None]
    points = np.where(j <= count, v + tau * (count - 2 * j), np.nan)
    every = np.sort(np.concatenate([samples, points]), axis=0)  # NaN goes last; 2 n + 1 are finite
    return np.asarray(np.take_along_axis(every, count[None], axis=0)[0])
