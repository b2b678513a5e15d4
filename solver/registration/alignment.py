"""Which frames can be placed, and where: from first guesses and searches to what does not fit."""

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.registration.equations import Equations
from solver.registration.fit import FITS, OVERLAP, STANDS_OUT, SUSPECT, misfits
from solver.registration.placement import Placement
from solver.registration.reference import why_no_reference, why_too_few
from solver.registration.start import find_start, period, seek_shifts, start_at

Float = NDArray[np.float64]

SAME = 2.0  # pixels, from where refinement ends in the same place


class Alignment:
    """One registration under way.

    Attributes:
        placed: where the frames are.
        period: pixels after which the reference repeats itself, so that a search finds one place as well as
            another; None = it does not.
    """

    def __init__(self, placement: Placement) -> None:
        self.placed = placement
        self.period = period(placement.levels, placement.reference)

    def drop_empty(self) -> None:
        """Reject frames without enough valid pixels.

        Raises:
            RegistrationError: the reference has none, or nothing to place the others by.
        """
        few = {k: why_too_few(weights) for k, weights in enumerate(self.placed.levels[0].weights)}
        self.placed.rejected |= {k: why for k, why in few.items() if why}
        others, reference = self.placed.active, self.placed.reference
        others[reference] = False
        why = why_no_reference(self.placed.levels, reference, others)
        if why:
            raise RegistrationError(f"frame {reference}, the reference, cannot be used: {why}")

    def align(self) -> None:
        """Place all frames; reject those that do not fit.

        A guess that no search improves is refined at once, and so is one with which every frame then fits to
        its noise, whatever a search finds: texture that repeats looks alike in other places too. Only where a
        frame does not fit is each aligned with the reference first; and one that still does not is looked
        for pixel by pixel before it is rejected. Where all repeats, nothing is searched further than half a
        period away.
        """
        found = self._searched(self.placed.guided)
        trusted = self.placed.guided and bool((found == self.placed.guess).all())
        together = None
        if self.placed.guided and not trusted:
            equations = self.placed.refine_together()
            if not self._misfits(equations) and equations.misfit[self.placed.active].max() < FITS:
                return
            together = self._confirmed(equations, found)
        elif not trusted:
            self._align_with_reference(found)
        sought = False
        for _ in range(5):  # rejecting a frame changes the mosaic, so the rest is refined again
            equations = together or self.placed.refine_together()
            together, wrong = None, self._misfits(equations)
            if not sought and not trusted:
                sought = True
                equations = self._sought(equations)
                wrong = self._misfits(equations)
            if wrong and trusted:
                trusted = False
                self._align_with_reference(found)
                continue
            wrong = self._foreign(wrong, equations)
            if not wrong:
                return
            self._reject(wrong)

    def _confirmed(self, equations: Equations, found: Float) -> Equations | None:
        """Align each with the reference; the equations if all lie where these place them, None otherwise."""
        places, covariance, rejected = (
            self.placed.parameters,
            self.placed.covariance,
            len(self.placed.rejected),
        )
        self._align_with_reference(found)
        if len(self.placed.rejected) > rejected or self.placed.apart(places) > SAME:
            return None
        self.placed.parameters, self.placed.covariance = places, covariance
        return equations

    def _sought(self, equations: Equations) -> Equations:
        """Have frames that may lie elsewhere looked for; the equations of the places that fit better."""
        suspects = list(self._misfits(equations, SUSPECT if not self.placed.guided else STANDS_OUT))
        if not suspects:
            return equations
        kept = self.placed.parameters.copy()
        self._seek(suspects)
        again = self.placed.refine_together()
        if again.misfit[suspects].mean() < equations.misfit[suspects].mean():
            return again
        self.placed.parameters = kept
        return equations

    def _seek(self, frames: list[int]) -> None:
        """Start frames anew from where they resemble the reference most, at full resolution."""
        if self.period is not None:
            self.placed.parameters[frames] = self._searched(self.placed.guided)[frames]
            return
        shifts = seek_shifts(self.placed.levels[0], self.placed.reference, frames)
        self.placed.parameters[frames] = start_at(shifts, self.placed.levels[0].shape, self.placed.motion)

    def _align_with_reference(self, start: Float) -> None:
        """Refine each frame against the reference alone; search anew where a guess was wrong."""
        self.placed.parameters = start
        equations = self.placed.refine_pairwise(self.placed.levels[-1])
        wrong = self._misfits(equations)
        if self.placed.guided and wrong and self.period is None:
            kept = self.placed.parameters
            self.placed.parameters = self._searched(guided=False)
            again = self.placed.refine_pairwise(self.placed.levels[-1])
            better = np.zeros(self.placed.count, dtype=bool)
            better[list(wrong)] = again.misfit[list(wrong)] < equations.misfit[list(wrong)]
            self.placed.parameters = np.where(better[:, None], self.placed.parameters, kept)
            wrong = {k: why for k, why in wrong.items() if not better[k]}
        if wrong:
            self._seek(list(wrong))
            coarse = self._misfits(self.placed.refine_pairwise(self.placed.levels[-1]))
            still = {k: why for k, why in coarse.items() if k in wrong}
            if still:
                kept = self.placed.parameters
                sharp = self.placed.refine_pairwise(self.placed.levels[0])
                self._reject(self._foreign(still, sharp))
                self.placed.parameters = kept

    def _searched(self, guided: bool) -> Float:
        placed = self.placed
        levels = placed.levels[-1], placed.levels[0].shape
        return find_start(*levels, placed.reference, placed.guess, placed.motion, guided, self.period)

    def _misfits(self, equations: Equations, most: float = STANDS_OUT) -> dict[int, str]:
        others = self.placed.active
        others[self.placed.reference] = False
        return misfits(equations, others, most)

    def _foreign(self, wrong: dict[int, str], equations: Equations) -> dict[int, str]:
        """Those of frames that do not fit which show something else, or hardly overlap the others."""
        doubtful = [k for k in wrong if equations.overlap[k] >= OVERLAP]
        in_place = self.placed.in_place(doubtful) if doubtful else []
        return {k: why for k, why in wrong.items() if k not in in_place}

    def _reject(self, found: dict[int, str]) -> None:
        self.placed.rejected |= found
        if not np.any(np.delete(self.placed.active, self.placed.reference)):
            reasons = "; ".join(f"frame {k} {why}" for k, why in sorted(self.placed.rejected.items()))
            raise RegistrationError(
                f"no frame could be aligned with frame {self.placed.reference}: {reasons}"
            )
