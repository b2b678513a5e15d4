"""Whether frames still show what a stream's problem was prepared for: the same scene, in the same light."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.preparation.problem import Problem

_FACTOR = 1.5
"""By how much light and noise of a frame may leave those of the frames that were prepared."""

_DISPUTED = 1e-3
"""Part of a frame's samples that the others may contradict, beside twice that of the frames prepared."""

_UNSEEN, _SAMPLE = 0.08, 0.5
"""Part of the grid that may be seen though no frame prepared saw it, and the part of a usual sample's
precision that counts as seen: what is dark comes and goes with the noise."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a frame looks like: the median of its amplitudes and its noise, 0 = not known."""

    light: float
    noise: float


@dataclass(frozen=True, slots=True)
class Basis:
    """What a problem was prepared for.

    Attributes:
        seen: (H, W), where there was light.
        disputed: part of a frame's samples that the others contradict, the least and the greatest.
        light, noise: the least and the greatest of the frames'; (0, ∞) where none is known.
    """

    seen: NDArray[np.bool_]
    disputed: tuple[float, float]
    light: tuple[float, float]
    noise: tuple[float, float]

    @classmethod
    def of(cls, problem: Problem, looks: list[Look]) -> Self:
        """What a problem is that was just prepared of frames that look so."""
        parts = np.zeros(1) if problem.consensus is None else problem.consensus.disputed()
        lights, noises = [look.light for look in looks], [look.noise for look in looks]
        disputed = float(parts.min()), float(parts.max())
        return cls(_seen(problem), disputed, _range(lights), _range(noises))

    @property
    def mixed(self) -> bool:
        """Whether the frames that it was prepared of do not suit each other."""
        apart = any(np.isfinite(most) and most > _FACTOR * least for least, most in (self.light, self.noise))
        return apart or _more(self.disputed[1], self.disputed[0])

    def suits(self, problem: Problem, look: Look) -> bool:
        """Whether what was learned suits a problem whose first exchanged frame looks so."""
        if not (_within(look.light, self.light) and _within(look.noise, self.noise)):
            return False
        if problem.consensus is not None:
            disputed = problem.consensus.disputed()[problem.exchanged[0]]
            if _more(disputed, self.disputed[1]):
                return False
        found = _seen(problem) & ~self.seen
        return bool(np.count_nonzero(found) <= _UNSEEN * found.size)


def _seen(problem: Problem) -> NDArray[np.bool_]:
    shape, cells = problem.distance.shape[1:], problem.options.upsampling**2
    mean = cv2.resize(problem.precision, shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(mean > _SAMPLE / cells)


def _more(disputed: float, usual: float) -> bool:
    return disputed > 2 * usual + _DISPUTED


def _range(values: list[float]) -> tuple[float, float]:
    known = [value for value in values if value > 0]
    return (min(known), max(known)) if known else (0.0, np.inf)


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return value == 0 or bounds[0] / _FACTOR <= value <= bounds[1] * _FACTOR
