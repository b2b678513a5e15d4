"""From a method's solution to the finished map."""

import numpy as np
from numpy.typing import NDArray

from solver.completion.deviation import deviation
from solver.completion.reason import reasons
from solver.errors import FusionInputError
from solver.optimisation.fill import reach, smooth
from solver.preparation.problem import Problem, Solution
from solver.preparation.wrapping import wrapped


def complete(
    problem: Problem, solution: Solution
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """(distance, deviation, reason), filled up to `fill` low-resolution pixels from the nearest used sample.

    Raises:
        FusionInputError: no pixel of the map is known.
        TypeError: the method gave no map of the fused size.
    """
    _check(problem, solution)
    away = reach(problem.precision > 0)
    known = np.isfinite(solution.distance)
    if known.all():
        distance = solution.distance.copy()
    elif known.any():
        distance, beyond = smooth(solution.distance, known, problem.options.fill * problem.options.upsampling)
        np.maximum(away, beyond, out=away)
    else:
        raise FusionInputError(
            "every pixel is darker than its noise: nothing is known of any distance; expose longer"
        )
    uncertain = deviation(problem, solution, away, distance)
    reason = reasons(problem, distance, away)
    return wrapped(distance, problem.cut, problem.ambiguity_range), uncertain, reason


def _check(problem: Problem, solution: Solution) -> None:
    for name, image in (("distance", solution.distance), ("amplitude", solution.amplitude)):
        if image is not None and (image.shape != problem.fused_shape or image.dtype != np.float32):
            raise TypeError(
                f"method {problem.options.method!r} gave a {name} of shape {image.shape}, {image.dtype}; "
                f"expected {problem.fused_shape}, float32"
            )
