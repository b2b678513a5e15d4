"""The noise law σ(distance) = c / amplitude: its constant, and what follows from it."""

import numpy as np
from numpy.typing import NDArray

from solver.problem import Problem

_MEDIAN_TO_SIGMA = 1.4826  # of the absolute value of a normal variable
_STANDS = 2.5  # deviations from which a step is one of the scene's: of noise alone, one in eighty is
_ENOUGH = 20_000  # values for a median or a percentile to a per cent
_FRAMES = 5  # enough samples for a median to a per cent, at a bounded cost


def estimate(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    ambiguity_range: float | None = None,
) -> float:
    """c of σ = c / amplitude, or σ itself without amplitude: from mixed second differences within the frames.

    The mask [1 −2 1; −2 4 −2; 1 −2 1] (Immerkær, "Fast noise variance estimation", CVIU 1996) cancels planes
    and edges along rows or columns; the median ignores what is left of the others. 0 where the frames are
    noise-free or too small to tell. Whole ambiguity ranges in a difference are wraps.
    """
    if min(distance.shape[1:]) < 3:
        return 0.0
    picked = np.linspace(0, len(distance) - 1, min(len(distance), _FRAMES)).astype(int)
    mixed = _masked(distance[picked], np.array([1.0, -2.0, 1.0]))
    if ambiguity_range is not None:
        mixed -= np.float32(ambiguity_range) * np.round(mixed / np.float32(ambiguity_range))
    mixed = np.abs(mixed)
    if amplitude is None:
        ratio = mixed / 6
    else:
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            ratio = mixed / np.sqrt(_masked(1 / amplitude[picked] ** 2, np.array([1.0, 4.0, 1.0])))
    values = ratio[np.isfinite(ratio)]
    values = values[:: max(1, values.size // _ENOUGH)]
    return _MEDIAN_TO_SIGMA * float(np.median(values)) if values.size else 0.0


def _masked(images: NDArray[np.float32], mask: NDArray[np.float64]) -> NDArray[np.float32]:
    """Images (N, H, W) under mask × mask, without the border."""
    a, b, c = mask.astype(np.float32)
    rows = a * images[:, :-2] + b * images[:, 1:-1] + c * images[:, 2:]
    return np.asarray(a * rows[..., :-2] + b * rows[..., 1:-1] + c * rows[..., 2:])


def deviations(
    distance: NDArray[np.float32], amplitude: NDArray[np.float32] | None, noise: float
) -> NDArray[np.float32]:
    """(N, H, W): one standard deviation of each sample; infinite at amplitude 0."""
    if amplitude is None:
        return np.full(distance.shape, noise, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(amplitude > 0, np.float32(noise) / amplitude, np.float32(np.inf))


def amplitude_threshold(amplitude: NDArray[np.float32], noise: float, ambiguity_range: float | None) -> float:
    """The amplitude under which a sample does more harm than good to an unweighted fusion.

    A sample of a fifth of the median amplitude has 25 times the usual variance. Under σ = range / 20 the
    phase itself is lost to noise.
    """
    lit = amplitude[amplitude > 0]
    if lit.size == 0:
        return 0.0
    relative = 0.2 * float(np.median(lit))
    lost = 20 * noise / ambiguity_range if ambiguity_range else 0.0
    return max(relative, lost)


def usual_deviation(problem: Problem) -> float:
    """The median deviation of the used samples, never 0, so that it can divide."""
    values = problem.sigma[np.isfinite(problem.distance) & np.isfinite(problem.sigma)]
    tiny = float(np.finfo(np.float32).tiny)
    return max(float(np.median(values[:: max(1, values.size // _ENOUGH)])), tiny) if values.size else tiny


def spread(distance: NDArray[np.float32]) -> float:
    """The range of the distances without the outermost 2 % at either end: the scene's, not the outliers'."""
    values = distance[np.isfinite(distance)]
    low, high = np.percentile(values[:: max(1, values.size // _ENOUGH)], [2, 98])
    return float(high - low)


def relief(problem: Problem) -> float:
    """The mean step between neighbouring pixels, counting those that stand out of their noise."""
    count = len(problem.distance)
    picked = np.linspace(0, count - 1, min(count, _FRAMES)).astype(int)
    distance, variance = problem.distance[picked], problem.sigma[picked] ** 2
    down = _standing(distance[:, 1:] - distance[:, :-1], variance[:, 1:] + variance[:, :-1])
    across = _standing(distance[..., 1:] - distance[..., :-1], variance[..., 1:] + variance[..., :-1])
    return 0.5 * (down + across)


def _standing(step: NDArray[np.float32], variance: NDArray[np.float32]) -> float:
    known = np.isfinite(step) & np.isfinite(variance)
    if not known.any():
        return 0.0
    size = np.abs(step[known])
    return float(np.where(size**2 > _STANDS**2 * variance[known], size, 0).mean(dtype=np.float64))
