"""Whether the stage does what it reports, judged by what every map says of the motion in its images."""

import logging

from service.daemon.states import States
from service.messages.report import AxisGain, BurstReport

_WRONG = 0.4
"""A gain this far from 1 is a fault; a lever arm of 0.1 m makes a tenth at 1 m, backlash rarely more."""

_SURE = 5.0
"""Deviations of the gain that it must be off besides: where there is little texture nothing is judged."""

_PART = "motion"
_REMEDY = "look at the stage: clutch, belt, screws, power; maps are made from what the images say meanwhile"

_log = logging.getLogger(__name__)


class MotionWatch:
    """Says that the stage is `degraded` where the images contradict it, until they no longer do.

    Args:
        states: where it is said.
    """

    def __init__(self, states: States) -> None:
        self._states = states
        self._said = False

    def note(self, report: BurstReport) -> None:
        """Judge the stage by a map of it; one that tells nothing of its motion changes nothing."""
        motion = report.motion
        if motion is None:
            return
        named = {"pan": motion.pan, "tilt": motion.tilt}
        judged = {name: gain for name, gain in named.items() if gain is not None}
        wrong = [_words(name, gain) for name, gain in judged.items() if _is_wrong(gain)]
        if wrong:
            self._degrade("; ".join(wrong))
        elif all(_is_right(gain) for gain in judged.values()):
            self._mend()

    def _degrade(self, what: str) -> None:
        if not self._said:
            _log.error("%s; %s", what, _REMEDY)
        self._said = True
        self._states.degrade(_PART, what, _REMEDY)

    def _mend(self) -> None:
        if self._said:
            _log.info("the stage turns as it says again")
        self._said = False
        self._states.mend(_PART)


def _is_wrong(gain: AxisGain) -> bool:
    return abs(gain.gain - 1) > max(_WRONG, _SURE * gain.deviation)


def _is_right(gain: AxisGain) -> bool:
    return abs(gain.gain - 1) <= _WRONG and _SURE * gain.deviation <= 1.0


def _words(axis: str, gain: AxisGain) -> str:
    says = f"the stage reports that it turns in {axis}, but the images show"
    if abs(gain.gain) <= _WRONG:
        return f"{says} no motion"
    if gain.gain < 0:
        return f"{says} that it turns the wrong way ({gain.gain:.1f} times as far)"
    return f"{says} {gain.gain:.1f} times as much"
