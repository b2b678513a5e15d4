"""Amplitude and distance apart: Z = exp(l + iφ), each with a heavy-tailed penalty of its own.

    E(l, φ) = ½ s Σ_k ‖y_k − A_k Z‖² + Σ_pairs w κ_l log(1 + (Δl / δ_l)²)
                                      + Σ_pairs w κ_φ |Z|^¼ log(1 + ((Δφ − t) / δ_φ)²) / ((1 + (Δl / e)²) g)

over pairs of neighbours, w one over their distance, s the inverse of the variance of a sample's component, so
that the first sum is the true log-likelihood: its weight grows with N and falls with the noise by itself. The
tilt t is what the slope of the surroundings foretells (see `optimisation.slope`), that of 1 / φ, which is the
same all over a plane. Print changes l and leaves φ; a pair's tail ties along an edge and frees across it.
Where the amplitude steps, a step of the distance is more likely, so its penalty is eased: else a dark thing
is drawn to what is bright around it. |Z| is that of the darker one of the two. g is what the prior gives way
by, where the samples contradict it (see `optimisation.discrepancy`).

It is not convex. The penalties lie under quadratics that touch them at the present state (see
`kernels.pairs`); the slope, the easing and g are held; and Z moves by Z exp x, which is linear in x for small
ones: Gauss–Newton, solved by conjugate gradients (see `kernels.newton`). The δ begin wide, which is nearly
quadratic, and are sharpened step by step (graduated non-convexity; Blake, Zisserman, "Visual
Reconstruction", 1987).
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import agreement, newton, pairs
from solver.kernels import factors as kernels
from solver.kernels.group import PAD
from solver.optimisation.discrepancy import discrepancy, eased, hidden, spread
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.information import doubt, information
from solver.optimisation.padding import padded
from solver.optimisation.schedule import Step
from solver.optimisation.slope import agreed, slope
from solver.options import NEIGHBOURHOOD, Offset
from solver.runtime import team

Image = NDArray[np.floating]

MODEL = 0.001
"""What the model errs by, in units of the RMS amplitude: it bounds s where there is hardly any noise."""

_LOG, _LOG_STEP, _LOG_BLUNT = 0.3, 0.035, 0.5
"""κ_l and δ_l, and the power of the bluntness that δ_l is widened by."""

_PHASE, _PHASE_STEP = 0.6, 0.002
"""κ_φ, and δ_φ in metres at the usual ambiguity range of 7.5 m: it is an angle."""

_USUALLY, _WIDER = 4, 0.25
"""β at which κ_φ and δ_φ are as they stand. κ_φ goes with 1 / β, as an edge of the same length has pairs as
β; at half of it smooth surfaces would so be held twice as hard, and δ_φ is a fifth wider there."""

_CALM = 0.0036
"""Deviation of |Z| where κ are as they stand; they go with its inverse root: half of them are best at four
times the noise, twice as much at a quarter."""

_EASE = 0.5
"""e, of the logarithm: a step of the amplitude by two thirds halves the penalty."""

_USUAL = 2 * np.pi / 7.5
_EDGE, _EDGE_BLUNT = 0.001 * _USUAL, 0.9
"""By how much φ rises more from one fused pixel to the next than the tilt before said where it is an edge and
has no say in the tilt; times this power of the bluntness. Counted from the tilt, not from level, so that a
steep floor has its say and the rim of a stair, smeared over some pixels, has none."""

_REACH, _REACHING = 1.6, 0.35
"""Low-resolution pixels over which the slope is averaged where the noise is `_CALM` of the usual light, and
the power of the noise that it goes by: a mean over h errs by h² where the scene is curved, and by σ / h² of
its noise. Half of either finds finer relief and leaves more noise on dim walls."""

_AGREED = 0.5
"""How far from a slope that a pixel takes its own rise may be, in units of an edge."""

_NEAR = 0.4
"""Part of the reach over which the slope is averaged where samples and map are apart."""

_STIFF = 2.0
"""What the data add to the preconditioner's diagonal, in units of their own: their operator blurs, so smooth
moves, which matter most, meet up to sixteen times that at β = 4. 125 rounds get as far as 156 with 1."""

_VOTING = 10.0
"""Deviations of |Z| at which a pixel has half a say in the tilt. Without, the noise around what has
nothing behind it gives its rim a slope."""

_FAINTEST = 0.03
"""The least |Z| at most, in units of the RMS amplitude: below some least one l would run away to −∞."""

_NOUGHT = 0.5
"""The least |Z| in units of its noise, well below what can be told from nothing."""

_TELLING = 20.0
"""Deviations that |Z| should have to tell a distance of its own, for amplitude steps to ease the penalty;
with 8, the rims of things before nothing, lit by half, and dots of a thirtieth of the light go astray."""

_GLARE = 0.06
"""Part of the brighter pixel's |Z| that the darker one's should be as well: the model errs by a part of it.
Without, dark print comes loose where there are many frames."""

_MOST = np.array([0.7, 0.3])
"""By how much l and φ may move in one step: the linearisation holds for less than 1."""

_DOUBT, _ERRING = 5.0, 0.1
"""Deviations and RMS amplitudes that a sample may differ from the map that has its edges."""


@dataclass(slots=True)
class Factored:
    """A map in the middle of the descent, all in units of the RMS amplitude.

    Attributes:
        term: the data, with values y; weights 0 to 1.
        scale: the RMS amplitude.
        weight: s.
        noise: of |Z|, deviation, where all samples of a low-resolution pixel tell of it.
        nearest: the φ, over 0, under which things are taken to be a turn farther; for the tilt alone.
        strength: factor on both κ, beside the one that the noise asks for.
        neighbourhood: offsets of the pairs.
        state: (2, rows + 4, columns + 4), l and φ, padded; z: its phasors.
    """

    term: AreaTerm
    scale: float
    weight: float
    noise: float
    nearest: float
    strength: float = 1.0
    neighbourhood: tuple[Offset, ...] = NEIGHBOURHOOD
    state: Image = field(init=False)
    z: Image = field(init=False)
    _square: Image = field(init=False)
    _power: Image = field(init=False)
    _lit: Image = field(init=False)
    _tilt: Image | None = field(init=False, default=None)
    _strengths: NDArray[np.uint16] = field(init=False)
    _work: tuple[Image, ...] = field(init=False)
    _bend: Image = field(init=False)
    _reach: float = field(init=False)
    _noisy: float = field(init=False)
    _moved: bool = field(init=False, default=False)
    _ease: Image = field(init=False)
    _loose: Image = field(init=False)
    _bent: Image = field(init=False)
    _near: Image = field(init=False)
    _doubts: Image = field(init=False)

    def __post_init__(self) -> None:
        mean = self.term.mean()
        length = np.hypot(mean[0], mean[1])
        first = np.stack([np.log(np.maximum(length, self._least)), np.arctan2(mean[1], mean[0])])
        self.state = padded(first.astype(np.float32))
        shape = self.state.shape
        self._strengths = np.zeros((2, pairs.PAIRS, *shape[1:]), np.uint16)
        self._work = tuple(np.zeros(shape, np.float32) for _ in range(5))
        self.z, self._bend = np.zeros(shape, np.float32), self.term.bend * np.float32(_STIFF)
        self._loose = np.ones(shape[1:], np.float32)
        self._near = np.zeros(self.term.shape[1:], np.float32)
        self._doubts = np.ones(self.term.shape[1:], np.float32)
        self._ease = np.ones([n // self.term.factor for n in self.term.shape[1:]], np.float32)
        self._square, self._lit = np.ones(shape[1:], np.float32), np.ones(shape[1:], np.float32)
        self._power = np.zeros(shape[1:], np.float32)
        self._noisy = self._doubt(length) / _CALM
        self._reach = self.term.factor * _REACH * self._noisy**_REACHING
        self._move(self._work[0])

    @property
    def _least(self) -> float:
        return min(_FAINTEST, _NOUGHT * self.noise)

    def _doubt(self, light: Image) -> float:
        """The noise in units of the usual light, where there is any: a few bright things raise the RMS."""
        lit = light[light > _VOTING * self.noise]
        return self.noise / float(np.median(lit)) if lit.size else self.noise

    def descend(self, step: Step, limit: int) -> int:
        """One step of Gauss–Newton; returns its rounds of conjugate gradients, at most `limit`."""
        last, x, right, inverse, product = self._work
        self._tilt = self._find_tilt(step.blunt)
        weight = np.float32(self.weight)
        self.term.pull(self.z, weight, product)
        if step.eases:
            apart = self._discrepancy(product)
            self._ease = eased(self._ease, apart)
            spread(self._ease, self._loose[PAD:-PAD, PAD:-PAD])
            spread(hidden(apart), self._near)
        state, data = (
            (self.state, self.z, self._loose, self._tilt[0], *self._laws(step.blunt)),
            (product, self._bend, weight),
        )
        team.share(pairs.assemble, *state, *data, *self._strengths, right, inverse)
        x[:] = 0
        rounds, sums = min(step.rounds, limit), np.zeros((x.shape[1] - 2 * PAD, 4))
        operator = self.z, self.term.stencil, weight, *self._strengths, inverse
        work = last, product
        team.run(newton.descend, rounds, self._moved, *operator, right, x, work, sums)
        self._move(x)
        # The next step begins in the direction of this one.
        self._work = x, last, right, inverse, product
        self._moved = True
        return rounds

    def _discrepancy(self, pull: Image) -> Image:
        return discrepancy(self.z, pull, self.term, np.float32(self.weight), self._noisy)

    def _find_tilt(self, blunt: float) -> Image:
        """(1, 2, rows + 4, columns + 4): what the surroundings foretell of φ's rise by row and by column."""
        edge, image = _EDGE * _USUALLY / self.term.factor * blunt**_EDGE_BLUNT, self.state[1:]
        votes = {"measure": self._square, "weight": self._lit}
        means = slope(image, edge, self._reach, before=self._tilt, **votes)
        side = 2 * round(self._reach) + 1
        light = np.asarray(cv2.blur(self._power, (side, side)), np.float32)
        noise = (self.noise * self.term.factor) ** 2
        tilt, self._bent = agreed(image, means, _AGREED * edge, self._reach, self._square, light, noise)
        if (self._near > 0).any():
            near = slope(image, edge, max(1.0, _NEAR * self._reach), before=self._tilt, **votes)
            team.share(agreement.bring, near[0], self._square, self._near, tilt[0])
        return tilt

    def _laws(self, blunt: float) -> tuple[NDArray[np.float64], tuple[float, ...], tuple[float, ...]]:
        factors = [float(o in self.neighbourhood) / np.hypot(*o) for o in NEIGHBOURHOOD[: pairs.PAIRS]]
        gain = self.strength * float(np.sqrt(_CALM / self.noise))
        logs = gain * _LOG, _LOG_STEP * blunt**_LOG_BLUNT
        finer = _USUALLY / self.term.factor
        phases = (
            gain * _PHASE * finer,
            _PHASE_STEP * _USUAL * blunt * max(1.0, finer) ** _WIDER,
            1 / _EASE**2,
            (_TELLING * self.noise) ** 2,
            _GLARE**2,
        )
        return np.array(factors), logs, phases

    def _move(self, x: Image) -> None:
        bounds = np.log(self._least), self.nearest, (_VOTING * self.noise) ** 2
        images = self.state, self.z, self._square, self._power, self._lit
        team.share(kernels.advance, x, _MOST, *bounds, *images)

    def distrust(self) -> None:
        """Weigh down samples that the map does not explain: deconvolution would fit them by swings."""
        deviation = float(np.sqrt(max(0.0, 1 / self.weight - MODEL**2)))
        self.term.distrust(self.z, None, _DOUBT * deviation, _ERRING)

    def objective(self) -> float:
        """E, with the penalties' true values at full sharpness, slope and g as the last step held them."""
        sums = np.zeros(self.state.shape[1] - 2 * PAD)
        assert self._tilt is not None
        team.share(pairs.cost, self.state, self.z, self._loose, self._tilt[0], *self._laws(1.0), sums)
        return 0.5 * self.weight * self.term.value(self.z) + float(sums.sum())

    def judge(self, *, followed: bool) -> None:
        """Find out where the map lacks what the samples show, for `information`.

        Args:
            followed: one frame was exchanged. The map then knows of frames that are gone, and is farther
                from those that are left, but no worse; so no more is found than was before.
        """
        pull, found = self._work[-1], np.empty_like(self._doubts)
        self.term.pull(self.z, np.float32(self.weight), pull)
        spread(doubt(self._discrepancy(pull), self._noisy), found)
        self._doubts = np.minimum(self._doubts, found) if followed else found

    def information(self) -> Image:
        """(rows, columns): inverse variance of φ, by what the data say and what `judge` found."""
        variance = max(1 / self.weight - MODEL**2, 1e-6 * MODEL**2)
        return information(self.z, self.term, variance, self._doubts, self._bent, self._reach)
