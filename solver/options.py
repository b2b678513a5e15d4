"""How to fuse: the choices a caller may make."""

from dataclasses import dataclass, field
from typing import Literal

Method = Literal["auto", "nearest", "bicubic", "shift-and-add", "ibsr", "mrf", "lidarboost", "area", "phasor"]

SINGLE: tuple[Method, ...] = ("nearest", "bicubic")
"""Methods that show one frame."""

Offset = tuple[int, int]

NEIGHBOURHOOD: tuple[Offset, ...] = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
"""(row, column) offsets of the prior: one and two pixels along the axes, one along the diagonals."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """The area a low-resolution pixel averages over, in low-resolution pixels.

    Attributes:
        side: of the light-sensitive square (the root of the fill factor).
        blur: standard deviation of a Gaussian on top of it, the lens's.
    """

    side: float = 1.0
    blur: float = 0.0


@dataclass(frozen=True, slots=True)
class FusionOptions:
    """Choices of one fusion.

    Attributes:
        method: which fusion; `auto` is `phasor` where amplitude and ambiguity range are given, else `area`.
        upsampling: β, the integer factor between low- and high-resolution pixels.
        regularization: λ, or `auto` to set it from the noise level. In units of distance; for `phasor`,
            which has no λ, a factor on its penalties, 1 = `auto` (they give way where samples contradict
            them); for `ibsr` the paper's, on distance rescaled to 0..182.
        tolerance: relative error of the objective at which the iteration stops, the last pass of `area` at
            four times it; `phasor` has steps instead.
        max_iterations: bound on the iterations; reaching it gives `converged = False` and a warning.
        amplitude_threshold: amplitude under which a sample is not used, in the amplitude's unit;
            0 = none, `auto` = from the noise law.
        fill: how far, in low-resolution pixels, unseen pixels are filled from the nearest used sample.
        neighbourhood: offsets of the prior of `lidarboost`, `area` and `phasor`: (0, 1), (1, 0) and any
            others of `NEIGHBOURHOOD`; `phasor` takes no notice of those two pixels apart.
        footprint: what a pixel averages over, for `area` and `phasor`.
    """

    method: Method = "auto"
    upsampling: int = 4
    regularization: float | Literal["auto"] = "auto"
    tolerance: float = 1e-3
    max_iterations: int = 1000
    amplitude_threshold: float | Literal["auto"] = "auto"
    fill: float = 5.0
    neighbourhood: tuple[Offset, ...] = NEIGHBOURHOOD
    footprint: Footprint = field(default_factory=Footprint)
