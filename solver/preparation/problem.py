"""What every method is given, and what it gives back: the border between `fuse` and the methods."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.kernels import sparse
from solver.optimisation.factored import Factored
from solver.optimisation.reweighting import Trail
from solver.options import FusionOptions
from solver.preparation import noise as noise_law
from solver.preparation.consensus import LOST, SURE, Consensus
from solver.preparation.unmixing import Unmixing
from solver.result import Progress
from solver.runtime import team


@dataclass
class Problem:
    """Registered frames, ready to be fused.

    Attributes:
        distance: (N, H, W) float32, NaN = not used.
        amplitude: (N, H, W) float32, linear in the received light, or None.
        positions: (N, H, W, 2) float32, (row, column) in low-resolution pixels of frame 0 at which each pixel
            looks; integer coordinates are pixel centres.
        sigma: (N, H, W) float32, one standard deviation of each distance sample; 0 = noise-free.
        noise: c in σ = c / amplitude; without amplitude, σ itself.
        ambiguity_range: in the unit of distance, or None.
        guide: (βH, βW) float32 intensity, or None.
        options: the caller's choices, `method` already resolved.
        threshold: the amplitude under which samples were left out; 0 = none were.
        cut: the distance under which samples lie beyond the range, and were brought there; see `wrapping`.
        farthest: the distance beyond which none is measured; see `farthest`.
        beyond: (N,), samples of each frame that are beyond it.
        consensus: what the frames say together; None where that is not asked, see `preparation.prepare`.
        scatter: (H, W), deviations where far from `noise` and no amplitude tells them, else 0, or None.
        exchanged: numbers of the frames that alone have changed since it was solved last; empty = all.
        changed: whether the scene is another one than before, so that no map goes on from what it was.
    """

    distance: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    positions: NDArray[np.float32]
    sigma: NDArray[np.float32]
    noise: float
    ambiguity_range: float | None
    guide: NDArray[np.float32] | None
    options: FusionOptions
    threshold: float = 0.0
    cut: float = 0.0
    farthest: float = np.inf
    beyond: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    consensus: Consensus | None = None
    scatter: NDArray[np.float32] | None = None
    exchanged: tuple[int, ...] = ()
    changed: bool = False

    @property
    def contradicted(self) -> float:
        """The part of the samples given that are too far, or that the other frames contradict."""
        beyond, against = int(self.beyond.sum()), 0
        if self.consensus is None:
            valid = int(np.isfinite(self.distance).sum())
        else:
            against, valid = self.consensus.verdicts()
        return (beyond + against) / max(1, beyond + valid)

    @property
    def fused_shape(self) -> tuple[int, int]:
        """(βH, βW)."""
        height, width = self.distance.shape[1:]
        return height * self.options.upsampling, width * self.options.upsampling

    @cached_property
    def precision(self) -> NDArray[np.float32]:
        """(βH, βW): Σ 1 / σ² of the samples on each fused pixel, relative to the usual sample's; 0 = none."""
        precision = np.zeros(self.fused_shape, np.float32)
        self.count(slice(None), precision, 1)
        return precision

    def count(self, frames: slice, precision: NDArray[np.float32], sign: int) -> None:
        """Add (1) or take away (−1) what frames contribute to the precision."""
        sigma = self.sigma[frames]
        team.share_frames(
            len(sigma),
            sparse.scatter_precision,
            self.distance[frames],
            sigma if self.noise else np.ones_like(sigma),
            self.positions[frames],
            float(self.options.upsampling),
            np.float32(self.usual_deviation if self.noise else 1.0),
            np.float32(sign),
            precision,
        )

    def sure(self) -> NDArray[np.float32]:
        """The distances without those that may be of no light at all, unless all may; NaN in their place."""
        if self.ambiguity_range is None:
            return self.distance
        kept = np.where(self.sigma <= SURE * self.ambiguity_range / LOST, self.distance, np.float32(np.nan))
        return kept if np.isfinite(kept).any() else self.distance

    @cached_property
    def usual_deviation(self) -> float:
        """The median of sigma over the sure samples, never 0; of those at first, where frames change."""
        return noise_law.usual_deviation(self.sure(), self.sigma)

    @cached_property
    def usual_light(self) -> float:
        """The median amplitude of the used samples, 0 where there is none; at first, where frames change."""
        return 0.0 if self.amplitude is None else noise_law.median_light(self.amplitude, self.distance)

    @cached_property
    def spread(self) -> float:
        """The scene's range of distances, see `solver.preparation.noise`; at first, where frames change."""
        return noise_law.spread(self.distance)

    @cached_property
    def unmixing(self) -> Unmixing | None:
        """How samples are mixed, where they average phasors; of those at first, where frames change."""
        if self.consensus is None or self.ambiguity_range is None:
            return None
        lost = self.ambiguity_range / LOST
        return Unmixing.learned(self.consensus, self.sigma, self.positions, self.amplitude, lost)


@dataclass(frozen=True, slots=True)
class Solution:
    """A method's map before filling.

    Attributes:
        distance: (βH, βW) float32, NaN = not known to the method.
        amplitude: (βH, βW) float32, or None.
        information: (βH, βW), the inverse variance of each distance, where the method knows it.
        relative: λ in units of one sample's deviation, or of √N / β of them, where the prior is convex.
        trail, course: for a warm start of the same method on about the same data.
        regularization, iterations, objective, gap, converged: as in `Report`.
    """

    distance: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    regularization: float | None
    iterations: int
    objective: float | None
    gap: float | None
    converged: bool
    relative: float | None = None
    information: NDArray[np.float32] | None = None
    trail: Trail | None = None
    course: Factored | None = None


__all__ = ["Problem", "Progress", "Solution"]
