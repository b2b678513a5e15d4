"""What a fusion returns."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, float | None, float | None], None]
"""Called with (iteration, objective, gap), the last two None where they are not known on the way; raising in
it cancels the fusion."""


@dataclass(frozen=True, slots=True)
class Seconds:
    """Wall-clock time of the two stages, in seconds."""

    registration: float
    solve: float


@dataclass(frozen=True, slots=True)
class Report:
    """How a fusion went.

    Attributes:
        method: the method used (never `auto`).
        regularization: the λ used, the factor on the penalties of `phasor`, or None for methods without one.
        iterations: iterations of the solve.
        objective: value of the method's objective at the result, or None for methods without one.
        gap: relative duality gap (P − D) / P, or None for methods without one and for a stream's later maps.
        converged: whether the stopping rule was met within `max_iterations`.
        seconds: time of registration and of the solve.
        noise: c in σ(distance) = c / amplitude (given or estimated); without amplitude, σ itself.
        used: numbers of the frames that were fused, in the order given.
        rejected: reason by frame number for those that were not.
        contradicted: the part of the valid samples that the other frames contradict, or that lie beyond three
            ambiguity ranges (100 times the median distance, where none is given); they were left out.
        notes: what else the caller should know, in words.
    """

    method: str
    regularization: float | None
    iterations: int
    objective: float | None
    gap: float | None
    converged: bool
    seconds: Seconds
    noise: float | None
    used: tuple[int, ...]
    rejected: dict[int, str] = field(default_factory=dict)
    contradicted: float = 0.0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Fused:
    """A fused map on the grid of frame 0, β times as fine.

    Attributes:
        distance: (βH, βW) float32, the unit of the input; NaN = unknown.
        deviation: (βH, βW) float32, one standard deviation, same unit.
        amplitude: (βH, βW) float32 where the method gives one.
        shifts: (N, 2) low-resolution pixels (dy, dx) at the image centre.
        rotations: (N, 3) rotation vectors in radians, or None where displacements were used.
        report: how the fusion went.
        reason: (βH, βW) uint8: 0 measured, 1 filled; unknown: 2 dark, 3 saturated, 4 contradicted, 5 outside.
    """

    distance: NDArray[np.float32]
    deviation: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    shifts: NDArray[np.float64]
    rotations: NDArray[np.float64] | None
    report: Report
    reason: NDArray[np.uint8]
