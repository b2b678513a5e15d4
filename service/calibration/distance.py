"""Systematic distance errors from frames of a flat wall: constant, cyclic, and of each pixel.

The harmonics of the cyclic error come from those of the modulation: four phase samples give the fourth
(Lange 2000; Kahlmann et al. 2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Corrections
from drivers.frame import Frame
from service.calibration.still import reduce_still
from service.calibration.wall_fit import Wall, WallFit
from service.errors import CalibrationError

SIGNIFICANT = 3.0
"""Standard deviations below which a cyclic term is left out."""


@dataclass(frozen=True)
class DistanceFit:
    """What was found.

    Attributes:
        corrections: what `Calibration.correct` subtracts.
        constant_deviation: one standard deviation of the constant, metres.
        left_out: harmonics that could not be told from noise, or that the walls do not span, with the reason.
        before, after: RMS residual of the walls without and with the corrections, metres.
        distances: perpendicular distance of each wall as fitted, metres.
        profile: (2, M) measured distance and error left by a fit of constant alone, metres.
        is_known: whether distances were given.
        ambiguity_range: metres.
    """

    corrections: Corrections
    constant_deviation: float
    left_out: tuple[str, ...]
    before: float
    after: float
    distances: tuple[float, ...]
    profile: NDArray[np.float64]
    is_known: bool
    ambiguity_range: float

    def apply(self, calibration: Calibration) -> Calibration:
        """`calibration` with these corrections."""
        return calibration.model_copy(update={"corrections": self.corrections})

    def __str__(self) -> str:
        found = self.corrections
        cyclic = "; ".join(
            f"harmonic {term.harmonic}: {1e3 * term.amplitude:.1f} mm at {term.phase:.2f} rad"
            for term in found.cyclic
        )
        pattern = f"{1e3 * np.std(found.per_pixel):.1f} mm RMS" if found.per_pixel else "none"
        means = "" if self.is_known else " (from the wall's flatness alone: give distances for a better one)"
        return (
            f"constant {1e3 * found.constant:.1f} ± {1e3 * self.constant_deviation:.1f} mm{means}; cyclic "
            f"{cyclic or 'none'}; pixel pattern {pattern}; residual {1e3 * self.before:.1f} mm before, "
            f"{1e3 * self.after:.1f} mm after" + "".join(f"; {reason}" for reason in self.left_out)
        )


def calibrate_distance(
    walls: Sequence[Sequence[Frame]],
    calibration: Calibration,
    distances: Sequence[float] | None = None,
    harmonics: Sequence[int] = (4,),
    per_pixel: bool = True,
) -> DistanceFit:
    """Fit the systematic errors of uncorrected frames.

    Args:
        walls: frames of each flat wall, which fills at least a third of the image.
        calibration: optics of the camera.
        distances: perpendicular distance of each wall from the projection centre, metres; None = not known.
        harmonics: of the cyclic error within one ambiguity range (four phase samples give the fourth).
        per_pixel: whether to fit a pattern of pixels.

    Raises:
        CalibrationError: no wall, settings that differ, distances that do not fit, or no flat wall in view.
    """
    stills = [reduce_still(frames) for frames in walls]
    given: list[float | None] = [None] * len(stills) if distances is None else list(distances)
    if not stills or len(given) != len(stills):
        raise CalibrationError(f"{len(stills)} walls and {len(given)} distances; expected one for each wall")
    if len({still.ambiguity_range for still in stills}) > 1:
        raise CalibrationError("the walls were taken at different modulation frequencies; expected one")
    fit = WallFit([Wall(s, d) for s, d in zip(stills, given, strict=True)], calibration)
    plain = fit.solve(())
    spanned, unspanned = fit.split_by_span(harmonics)
    full = fit.solve(spanned)
    weak = [h for h in spanned if fit.strength(full, spanned, h) < SIGNIFICANT]
    kept = tuple(h for h in spanned if h not in weak)
    solved = full if not weak else fit.solve(kept)
    pattern = fit.pattern(solved, kept) if per_pixel else None
    _, _, spread = fit.read(solved, kept)  # of the walls alone: the pattern takes up what they leave open
    if pattern is not None:
        solved = fit.solve(kept, pattern)
        pattern = fit.pattern(solved, kept)
    constant, terms, _ = fit.read(solved, kept)
    rows = tuple(map(tuple, pattern.tolist())) if pattern is not None else ()
    left = [*unspanned, *(f"harmonic {h} left out: no stronger than its uncertainty" for h in weak)]
    return DistanceFit(
        corrections=Corrections(constant=constant, cyclic=terms, per_pixel=rows),
        constant_deviation=spread,
        left_out=tuple(left),
        before=fit.rms(plain, ()),
        after=fit.rms(solved, kept, pattern),
        distances=tuple(float(1 / np.linalg.norm(q)) for q in solved.planes),
        profile=fit.profile(plain),
        is_known=distances is not None,
        ambiguity_range=stills[0].ambiguity_range,
    )
