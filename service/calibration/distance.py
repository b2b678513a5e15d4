"""Systematic distance errors from frames of a flat wall: constant, cyclic, and of each pixel.

The harmonics of the cyclic error come from those of the modulation: four phase samples give the fourth
(Lange 2000; Kahlmann et al. 2006). A pattern of the pixels would take up whatever a wall is not, so what is
found is judged on frames that it was not fitted to, and walls that are none are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Corrections
from drivers.frame import Frame
from service.calibration.still import reduce_still
from service.calibration.wall import Wall
from service.calibration.wall_fit import Solution, WallFit
from service.errors import CalibrationError

SIGNIFICANT = 3.0
"""Standard deviations below which a cyclic term is left out."""

LARGEST_RESIDUAL = 0.05
"""Metres RMS about a flat wall, beside constant and cyclic errors: patterns of such cameras have millimetres
to two centimetres, a corner of a room or things before the wall have decimetres."""

LARGE_PATTERN = 0.03
"""Metres RMS from which a pattern is worth a warning."""

LARGE_CONSTANT, LARGEST_CONSTANT = 0.25, 1.0
"""Metres from which a constant is worth a warning, and at which it is refused: light takes 3 ns for half a
metre there and back; what is more comes from a wrong distance, not from a camera."""

APART = 0.06
"""Metres by which a wall may be off what the others say: twice a large cyclic error."""

WORSE, NOTABLE = 2.5, 0.01
"""Times the median residual of all walls, and metres, from which one is told."""


@dataclass(frozen=True)
class DistanceFit:
    """What was found.

    Attributes:
        corrections: what `Calibration.correct` subtracts.
        constant_deviation: one standard deviation of the constant, metres.
        left_out: harmonics that could not be told from noise, or that the walls do not span, with the reason.
        before, after: RMS residual of the walls without and with the corrections, metres; where `is_checked`,
            of frames that the corrections were not fitted to.
        is_checked: whether there were such frames.
        noise: what of `after` is noise of the frames, metres; None = not known of single frames.
        walls: (K,) residual of each wall with the corrections and without the noise, metres.
        distances: perpendicular distance of each wall as fitted, metres.
        profile: (2, M) measured distance and mean error there, metres.
        is_known: whether distances were given.
        ambiguity_range: metres.
    """

    corrections: Corrections
    constant_deviation: float
    left_out: tuple[str, ...]
    before: float
    after: float
    is_checked: bool
    noise: float | None
    walls: tuple[float, ...]
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
            f"{1e3 * self.after:.1f} mm after, on frames {'held out' if self.is_checked else 'fitted'}"
            + (f" (noise {1e3 * self.noise:.1f} mm)" if self.noise is not None else "")
            + "".join(f"; {reason}" for reason in self.left_out)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may be wrong with the walls or the distances given."""
        found, said = self.corrections, []
        if abs(found.constant) > LARGE_CONSTANT:
            said.append(
                f"a constant of {1e3 * found.constant:.0f} mm is large: check the distances given (from the "
                "camera's projection centre, square to the wall) and the modulation frequency"
            )
        spread = float(np.std(found.per_pixel)) if found.per_pixel else 0.0
        if spread > LARGE_PATTERN:
            said.append(
                f"a pattern of {1e3 * spread:.0f} mm RMS is large: is the wall bare and flat, and are the "
                "intrinsics those of this lens?"
            )
        usual = float(np.median(self.walls))
        for number, residual in enumerate(self.walls, start=1):
            if residual > max(NOTABLE, WORSE * usual):
                said.append(
                    f"wall {number} fits worse than the others ({1e3 * residual:.1f} mm, they have "
                    f"{1e3 * usual:.1f} mm): look whether anything stands before it, or leave it out"
                )
        return tuple(said)


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
    given: list[float | None] = [None] * len(walls) if distances is None else list(distances)
    if not walls or len(given) != len(walls):
        raise CalibrationError(f"{len(walls)} walls and {len(given)} distances; expected one for each wall")
    fit = _wall_fit(walls, given, calibration)
    _check_distances(fit, given)
    plain = fit.solve(())
    spanned, left = fit.split_by_span(harmonics)
    full = fit.solve(spanned)
    weak = [h for h in spanned if fit.strength(full, spanned, h) < SIGNIFICANT]
    kept = tuple(h for h in spanned if h not in weak)
    left += [f"harmonic {h} left out: no stronger than its uncertainty" for h in weak]
    solved = full if not weak else fit.solve(kept)
    _check_flatness(fit.wall_rms(solved, kept))
    _, _, spread = fit.read(solved, kept)  # of the walls alone: the pattern takes up what they leave open
    is_checked = min(map(len, walls)) > 1
    if per_pixel and not is_checked:
        left.append("pixel pattern left out: one frame of a wall does not tell it from noise; take more")
    pattern, noise = None, np.zeros(len(walls))
    if is_checked:
        noise = fit.noise_rms() / np.sqrt([len(frames) // 2 for frames in walls])
        before, after = _held_out(walls, given, calibration, kept)
    else:
        before, after = fit.wall_rms(plain, ()), fit.wall_rms(solved, kept)
    if per_pixel and is_checked:
        _, patterned = _held_out(walls, given, calibration, kept, per_pixel)
        if _mean(patterned) < _mean(after):
            after = patterned
            solved, pattern = _with_pattern(fit, solved, kept)
        else:
            left.append("pixel pattern left out: none stands out of the noise")
    constant, terms, _ = fit.read(solved, kept)
    return DistanceFit(
        corrections=Corrections(
            constant=constant,
            cyclic=terms,
            per_pixel=tuple(map(tuple, pattern.tolist())) if pattern is not None else (),
        ),
        constant_deviation=spread,
        left_out=tuple(left),
        before=_mean(before),
        after=_mean(after),
        is_checked=is_checked,
        noise=_mean(noise) if is_checked else None,
        walls=tuple(map(float, np.sqrt(np.maximum(after**2 - noise**2, 0)))),
        distances=tuple(float(1 / np.linalg.norm(q)) for q in solved.planes),
        profile=fit.profile(solved, kept),
        is_known=distances is not None,
        ambiguity_range=fit.ambiguity_range,
    )


def _wall_fit(
    walls: Sequence[Sequence[Frame]], distances: Sequence[float | None], calibration: Calibration
) -> WallFit:
    stills = [reduce_still(frames) for frames in walls]
    if len({still.ambiguity_range for still in stills}) > 1:
        raise CalibrationError("the walls were taken at different modulation frequencies; expected one")
    return WallFit([Wall(s, d) for s, d in zip(stills, distances, strict=True)], calibration)


def _with_pattern(
    fit: WallFit, solved: Solution, harmonics: Sequence[int]
) -> tuple[Solution, NDArray[np.float64]]:
    """The pattern that a solution leaves over, and the solution and pattern once it is known."""
    solved = fit.solve(harmonics, fit.pattern(solved, harmonics))
    return solved, fit.pattern(solved, harmonics)


def _held_out(
    walls: Sequence[Sequence[Frame]],
    distances: Sequence[float | None],
    calibration: Calibration,
    harmonics: Sequence[int],
    per_pixel: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(K,) residuals of each wall before and after: of every second frame by a fit to the others."""
    before, after = [], []
    parts = [_wall_fit([frames[n::2] for frames in walls], distances, calibration) for n in (0, 1)]
    for learnt, other in (parts, parts[::-1]):
        solved, pattern = learnt.solve(harmonics), None
        if per_pixel:
            solved, pattern = _with_pattern(learnt, solved, harmonics)
        before.append(other.wall_rms(other.solve(()), ()))
        after.append(other.wall_rms(other.refit(solved, harmonics, pattern), harmonics, pattern))
    return np.sqrt(np.mean(np.square(before), axis=0)), np.sqrt(np.mean(np.square(after), axis=0))


def _mean(residuals: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(residuals**2)))


def _check_flatness(residuals: NDArray[np.float64]) -> None:
    bad = [number for number, residual in enumerate(residuals, start=1) if residual > LARGEST_RESIDUAL]
    if bad:
        raise CalibrationError(
            f"wall {bad[0]} is no flat wall: off by {1e3 * residuals[bad[0] - 1]:.0f} mm RMS, at most "
            f"{1e3 * LARGEST_RESIDUAL:.0f} mm are expected of a camera"
            + (f" (walls {', '.join(map(str, bad[1:]))} likewise)" if bad[1:] else "")
            + ": fill the view with one bare wall, and give the distances in the order of the recordings"
        )


def _check_distances(fit: WallFit, given: Sequence[float | None]) -> None:
    """The distances given explain what was measured by one plausible constant."""
    off = fit.measured_distances() - np.array([np.nan if d is None else d for d in given])
    known = np.flatnonzero(np.isfinite(off))
    if not known.size:
        return
    usual = float(np.median(off[known]))
    if abs(usual) > LARGEST_CONSTANT:
        raise CalibrationError(
            f"measured distances are {1e3 * usual:+.0f} mm off those given, at most "
            f"{1e3 * LARGEST_CONSTANT:.0f} mm are plausible: check them, and the modulation frequency"
        )
    for wall in known if known.size > 2 else ():
        if abs(off[wall] - usual) > APART:
            raise CalibrationError(
                f"wall {wall + 1}, given as {given[int(wall)]:g} m away, is measured "
                f"{1e3 * off[wall]:+.0f} mm off, the others {1e3 * usual:+.0f} mm: measure its distance "
                "again, and give the distances in the order of the recordings"
            )
