"""The iteration: Chambolle and Pock's primal–dual algorithm, its stopping rule and its certificate.

Source: Chambolle, Pock, "A first-order primal-dual algorithm for convex problems with applications to
imaging", JMIV 2011, algorithm 1 with θ = 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from solver.result import Progress

_CHECK = 20
"""Iterations between two evaluations of the objective, which costs about as much as two iterations."""


@dataclass(slots=True)
class Iteration:
    """Runs an iteration until its objective has settled.

    The objective of such iterations falls like 1/k or faster, so its error after k iterations is at most
    its fall since iteration k/2. The iteration stops where that fall is below `tolerance`, twice in a row.

    Attributes:
        advance: runs this many iterations.
        objective: the objective of the current map.
        bound: a lower bound of the least objective, from the dual variables.
    """

    advance: Callable[[int], None]
    objective: Callable[[], float]
    bound: Callable[[], float]
    tolerance: float
    limit: int
    progress: Progress | None = None
    history: list[tuple[int, float]] = field(default_factory=list)

    def run(self) -> tuple[int, float, float, bool]:
        """(iterations, objective, relative gap, converged)."""
        done, settled = 0, 0
        self.history = [(0, self.objective())]
        while done < self.limit and settled < 2:
            step = min(_CHECK, self.limit - done)
            self.advance(step)
            done += step
            value = self.objective()
            self.history.append((done, value))
            earlier = min(p for k, p in self.history if k <= max(done // 2, 1))
            settled = settled + 1 if done > _CHECK and earlier - value <= self.tolerance * value else 0
            if self.progress is not None:
                self.progress(done, value, None)
        value = self.history[-1][1]
        gap = max(0.0, value - self.bound()) / value if value > 0 else 0.0
        return done, value, gap, settled >= 2 or gap <= self.tolerance
