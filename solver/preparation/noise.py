"""The noise law σ(distance) = c / amplitude: its constant, and what follows from it."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import differences as kernels

_MEDIAN_TO_SIGMA = 1.4826  # of the absolute value of a normal variable
_CORE, _CORE_SQUARE = 1.5, 0.55158  # deviations; the mean square of a normal variable within as many
_ROUNDS = 50  # of a fixed point that some ten reach, unless there is no noise
_BANDS = 16  # of light: enough to part sky from ground, and each with enough differences for a median
_FOLDED = 0.11  # of the range: the median of |normal variables| of which it holds ±3 deviations
_ENOUGH = 20_000  # values for a median or a percentile to a per cent
_FRAMES = 5  # enough samples for a median to a per cent, at a bounded cost


def estimate(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    ambiguity_range: float | None = None,
) -> float:
    """c of σ = c / amplitude, or σ itself without amplitude: from mixed second differences within the frames.

    The mask [1 −2 1; −2 4 −2; 1 −2 1] (Immerkær, "Fast noise variance estimation", CVIU 1996) cancels planes
    and edges along rows or columns; what is left of the others is large. 0 where the frames are
    noise-free or too small to tell. Whole ambiguity ranges in a difference are wraps, and where the noise
    spans the range they bound it while 1 / A still grows: such differences would tell of little noise and are
    left out.
    """
    picked = _picked(distance, amplitude)
    if amplitude is None:
        inverse = np.empty((0, *distance.shape[1:]), np.float32)
    else:
        with np.errstate(divide="ignore", over="ignore"):
            inverse = 1 / amplitude[picked] ** 2
    ratios, scales = kernels.mixed_differences(distance[picked], inverse, np.float32(ambiguity_range or 0))
    if not ratios.size:
        return 0.0
    some = slice(None, None, max(1, ratios.size // _ENOUGH))
    ratios, scales = ratios[some], scales[some]
    if amplitude is None or not ambiguity_range:
        return _core(ratios)
    return _core(ratios[_unfolded(ratios * scales, scales, ambiguity_range)])


def _unfolded(
    differences: NDArray[np.float32], scales: NDArray[np.float32], ambiguity_range: float
) -> NDArray[np.intp]:
    """Which differences count, of deviations in proportion to the scales: those of bands that are not folded.

    The brightest band where all are: of what is lost in noise all over, no more can be said.
    """
    bands = np.array_split(np.argsort(scales, kind="stable"), min(_BANDS, scales.size))
    most = _FOLDED * ambiguity_range
    held = [band for band in bands if _median(differences[band]) <= most]
    return np.concatenate(held or bands[:1])


def _core(ratios: NDArray[np.float32]) -> float:
    """The deviation of which so many |normal variables| are the small ones among these.

    That of the values below 1.5 of itself, which edges and fine relief, large where they are, reach less than
    they raise a median.
    """
    ranked = np.sort(ratios)
    squares = np.cumsum(np.square(ranked, dtype=np.float64))
    sigma = _MEDIAN_TO_SIGMA * _quantile(ranked, 0.5)
    for _ in range(_ROUNDS):
        count = int(np.searchsorted(ranked, _CORE * sigma))
        before, sigma = sigma, float(np.sqrt(squares[count - 1] / (count * _CORE_SQUARE))) if count else 0.0
        if abs(sigma - before) <= 1e-3 * before:
            break
    return sigma


def amplitude_threshold(amplitude: NDArray[np.float32], noise: float, ambiguity_range: float | None) -> float:
    """The amplitude under which a sample does more harm than good to an unweighted fusion.

    A sample of a fifth of the median amplitude has 25 times the usual variance. Under σ = range / 20 the
    phase itself is lost to noise.
    """
    usual = median_light(amplitude, amplitude)
    lost = 20 * noise / ambiguity_range if ambiguity_range and usual else 0.0
    return max(0.2 * usual, lost)


def median_light(amplitude: NDArray[np.float32], distance: NDArray[np.float32]) -> float:
    """The median of the positive amplitudes of the valid distances, 0 where there are none."""
    values = _thinned(amplitude, distance, 0.0)
    return _median(values) if values.size else 0.0


def usual_deviation(distance: NDArray[np.float32], sigma: NDArray[np.float32]) -> float:
    """The median deviation of the used samples, never 0, so that it can divide."""
    values = _thinned(sigma, distance)
    tiny = float(np.finfo(np.float32).tiny)
    return max(_median(values), tiny) if values.size else tiny


def usual_distance(distance: NDArray[np.float32]) -> float:
    """The median of the distances that are not 0, whatever their sign; 0 where there are none."""
    values = _thinned(np.abs(distance), distance, 0.0)
    return _median(values) if values.size else 0.0


def spread(distance: NDArray[np.float32]) -> float:
    """The range of the distances without the outermost 2 % at either end: the scene's, not the outliers'."""
    ranked = np.sort(_thinned(distance, distance))
    return _quantile(ranked, 0.98) - _quantile(ranked, 0.02)


def _picked(distance: NDArray[np.float32], amplitude: NDArray[np.float32] | None) -> NDArray[np.intp]:
    """Frames spread over all of those that can tell: with valid distances and with light."""
    valid = np.isfinite(distance)
    telling = np.flatnonzero((valid if amplitude is None else valid & (amplitude > 0)).any(axis=(1, 2)))
    picked = min(len(telling), _FRAMES)
    return telling[np.arange(picked) * (len(telling) - 1) // max(1, picked - 1)]


def _thinned(
    values: NDArray[np.float32], others: NDArray[np.float32], least: float = -np.inf
) -> NDArray[np.float32]:
    contiguous = np.ascontiguousarray(values), np.ascontiguousarray(others)
    return np.asarray(kernels.thinned(*contiguous, np.float32(least), _ENOUGH))


def _median(values: NDArray[np.float32]) -> float:
    return _quantile(np.sort(values), 0.5)


def _quantile(ranked: NDArray[np.float32], share: float) -> float:
    """Linear between ranks. NumPy's own takes longer to start than a small image takes to fuse."""
    rank = share * (len(ranked) - 1)
    low = int(rank)
    high = min(low + 1, len(ranked) - 1)
    return float(ranked[low]) + (rank - low) * (float(ranked[high]) - float(ranked[low]))
