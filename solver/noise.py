"""The noise law σ(distance) = c / amplitude: its constant, and what follows from it."""

import numpy as np
from numpy.typing import NDArray

_MEDIAN_TO_SIGMA = 1.4826  # of the absolute value of a normal variable
_FRAMES = 5  # enough samples for a median to a per cent, at a bounded cost


def estimate(distance: NDArray[np.float32], amplitude: NDArray[np.float32] | None) -> float:
    """c of σ = c / amplitude, or σ itself without amplitude: from second differences within the frames.

    On a smooth surface d(j − 1) − 2 d(j) + d(j + 1) is noise alone; the median ignores the edges.
    0 where the frames are noise-free or too small to tell.
    """
    picked = np.linspace(0, len(distance) - 1, min(len(distance), _FRAMES)).astype(int)
    parts = []
    for axis in (1, 2):
        if distance.shape[axis] < 3:
            continue
        d = np.moveaxis(distance[picked], axis, -1)
        second = d[..., :-2] - 2 * d[..., 1:-1] + d[..., 2:]
        scale: NDArray[np.float32] | float = float(np.sqrt(6.0))
        if amplitude is not None:
            a = np.moveaxis(amplitude[picked], axis, -1)
            with np.errstate(divide="ignore", over="ignore"):
                inverse = 1 / a**2
            scale = np.sqrt(inverse[..., :-2] + 4 * inverse[..., 1:-1] + inverse[..., 2:])
        ratio = np.abs(second) / scale
        parts.append(ratio[np.isfinite(second) & np.isfinite(scale)])
    values = np.concatenate(parts) if parts else np.empty(0, np.float32)
    return _MEDIAN_TO_SIGMA * float(np.median(values)) if values.size else 0.0


def deviations(
    distance: NDArray[np.float32], amplitude: NDArray[np.float32] | None, noise: float
) -> NDArray[np.float32]:
    """(N, H, W): one standard deviation of each sample; infinite at amplitude 0."""
    if amplitude is None:
        return np.full(distance.shape, noise, np.float32)
    with np.errstate(divide="ignore"):
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
