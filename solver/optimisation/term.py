"""What the iteration works on: a map on its way, and a convex quadratic data term."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solver.kernels import blur, tying
from solver.optimisation.padding import padded
from solver.optimisation.prior import Prior, level
from solver.runtime import team

Image = NDArray[np.floating]


@dataclass(slots=True)
class State:
    """A map in the middle of an iteration; arrays are padded by two pixels, (C, rows + 4, columns + 4)."""

    x: Image
    radius: Image
    """λ by pixel, in units of λ: 1 everywhere unless the prior is weighted."""
    slope: Image
    """(C, 2, rows + 4, columns + 4), what `solver.optimisation.slope` foretells, or (C, 2, 0, 0) = level."""
    epsilon: float = 0.0
    """Below which the corner of the norm was last rounded, in units of λ; 0 = not begun."""
    fit: float | None = None
    """The data term's value at this map, where it is known."""


@dataclass(frozen=True, slots=True)
class Operator:
    """The second derivative of a data term, as the compiled loop takes it.

    Attributes:
        footprint: (stencil, side, taps, size) of `kernels.blur.apply`; None = diagonal, the term's curvature.
        mean: (C, rows + 4, columns + 4), the map that a diagonal operator draws to.
        ties: (levels, unit, lift) of `kernels.tying`, with a footprint only; the lift, (C, …), is what their
            slope adds to the gradient.
    """

    footprint: tuple[Image, Image, Image, int] | None
    mean: Image | None = None
    ties: tuple[NDArray[np.uint8], Image, Image] | None = None

    def gradient(self, x: Image, out: Image) -> None:
        """out ← the data term's gradient at a padded map; with a footprint only."""
        assert self.footprint is not None
        self._transform(x, self.footprint[1], out)
        if self.ties is not None:
            out += self.ties[2]

    def multiply(self, image: Image, out: Image) -> None:
        """out ← the operator times a padded image; with a footprint only."""
        assert self.footprint is not None
        self._transform(image, self.footprint[1][:, :0, :0], out)

    def _transform(self, image: Image, side: Image, out: Image) -> None:
        assert self.footprint is not None
        stencil, _, taps, size = self.footprint
        team.share(blur.transform, image, stencil, side, taps, size, image.dtype.type(2), out)
        if self.ties is not None:
            team.share(tying.pull_all, image, *self.ties[:2], out)


class Term(Protocol):
    """A convex quadratic data term, all in units of λ."""

    @property
    def curvature(self) -> Image:
        """(rows + 4, columns + 4), positive where data fall: what stands for its operator's diagonal."""
        ...

    def operator(self) -> Operator:
        """Its second derivative."""
        ...

    def value(self, x: Image) -> float:
        """The term at a padded map."""
        ...

    def certify(self, state: State, dual: Image, prior: Prior) -> tuple[float, float]:
        """(its value, a lower bound of the least objective) from feasible duals; good near the optimum."""
        ...


def start(initial: Image) -> State:
    """A state at the map (C, rows, columns)."""
    return start_at(padded(initial))


def start_at(x: Image) -> State:
    """A state at the padded map, its prior neither weighted nor tilted."""
    return State(x, np.ones_like(x[0]), level(x))
