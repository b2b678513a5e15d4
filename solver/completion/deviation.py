"""One standard deviation per fused pixel, from the noise of the samples around it and the slope of the map.

    deviation² = (a σ)² / n + (b ‖∇X‖)²,   a² = floor² + (share · σ / λ)²

n samples of deviation σ lie within one low-resolution pixel; the prior averages over more of them the larger
λ is, but no further than the scene's own structure. A variance that a method knows stands for the first part.
On slopes and edges the error is one of place, and b is in fused pixels; where a slope is foretold, only what
bends is out of place. The constants come from simulated scenes (tests/solver/test_deviation.py holds them).
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import uncertainty as kernels
from solver.options import SINGLE
from solver.preparation.problem import Problem, Solution
from solver.runtime import team

_LEVEL, _SLOPED = (0.35, 0.14, 0.23, 0.42), {"area": (0.18, 0.03, 0.03, 0.3)}
"""Floor, share of σ / λ, and b, also where samples average phasors, which displaces edges: for a prior of
first order, and by method for one that lets ramps pass."""

_BENT = 1.0
"""b where a method knows its variance, and ∇∇X in the place of ∇X: such a one lets ramps pass, and with ∇X
the deviation of a floor that runs away is far too large."""

_LEAST = 0.01
"""Samples that stand for none: blurred rounding errors are no samples."""


def deviation(
    problem: Problem,
    solution: Solution,
    away: NDArray[np.float32],
    distance: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(βH, βW) for a filled map; doubled with each low-resolution pixel that the nearest sample is away.

    Args:
        away: in fused pixels. NaN, in the distance too, further than `fill` low-resolution pixels away.
    """
    factor = problem.options.upsampling
    out = np.empty_like(distance)
    if solution.information is not None:
        law = np.float32(1), np.float32(np.finfo(np.float32).tiny), np.float32(_BENT)
        team.share(kernels.combine, distance, solution.information, factor, *law, True, out)
        return _faded(problem, away, out, distance)
    usual = problem.usual_deviation if problem.noise else 0.0
    floor, share, *shifts = _SLOPED.get(problem.options.method, _LEVEL)
    shift = shifts[problem.ambiguity_range is not None]
    relative = solution.relative
    smoothing = 1.0 if relative is None else float(np.hypot(floor, share / relative))
    frames = len(problem.distance) if problem.options.method in SINGLE else 1
    each = factor**2 / frames  # samples, for one on average
    team.share(
        kernels.combine,
        distance,
        problem.precision,
        factor,
        np.float32(smoothing * usual / np.sqrt(each)),
        np.float32(_LEAST / each),
        np.float32(shift),
        False,
        out,
    )
    return _faded(problem, away, out, distance)


def _faded(
    problem: Problem, away: NDArray[np.float32], out: NDArray[np.float32], distance: NDArray[np.float32]
) -> NDArray[np.float32]:
    units = np.float32(1 / problem.options.upsampling), np.float32(problem.options.fill)
    team.share(kernels.fade, away, *units, out, distance)
    return out
