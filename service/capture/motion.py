"""Who lets the stage move: announced movements of a plan, homing only by consent, nothing after a failure."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import degrees
from typing import Literal

from drivers.errors import DeviceLostError, OperationError
from drivers.position import Position
from drivers.stage import Stage
from service.errors import MotionError

HomePolicy = Literal["ask", "at start", "never"]

_REHOMINGS = 2
"""Times that a stage opened again is homed in one run: what loses its position more often needs a person."""

_log = logging.getLogger(__name__)


class Operator:
    """The person beside the stage, told what is about to move and asked whether it may; here, nobody."""

    def tell(self, what: str) -> None:
        """Say what is about to move."""
        _log.info("%s", what)

    def ask(self, question: str, interrupted: Callable[[], bool]) -> bool:  # noqa: ARG002
        """Whether the person consents; waiting for the answer ends with `interrupted`."""
        return False


class Motion:
    """All movements of the stage.

    Starting a scan is consent to its poses and the way to the first of them; homing needs one of its own.
    What fails for another reason than a lost device is final: `MotionError`, and nothing moves any more; if
    it cost the position, only a person's consent leads to homing.

    Args:
        stage: of the rig.
        home: when an unknown position may be found by homing.
        operator: who is told and asked.
    """

    def __init__(self, stage: Stage, home: HomePolicy, operator: Operator) -> None:
        self._stage, self._home, self._operator = stage, home, operator
        self._homings = 0
        self._failed = False
        self._announced: Sequence[Position] | None = None

    def prepare(self, poses: Sequence[Position]) -> None:
        """Make sure that the position is known, and say once where the stage is about to turn.

        Raises:
            MotionError: nobody consents to homing, or it failed.
            MotionStoppedError, DeviceLostError: as `Stage.home`.
        """
        if self._stage.needs_home:
            self._find_position()
        if poses is not self._announced:
            self._announce(poses)
            self._announced = poses

    def go(self, target: Position, timeout: float) -> None:
        """Turn to `target`, at most `timeout` seconds longer than it takes at its speed.

        Raises:
            MotionError: the stage refuses, hits a limit, or does not arrive; it was stopped.
            MotionStoppedError, DeviceLostError: as `Stage.wait`.
        """
        with self._final():
            self._stage.move_to(target.pan, target.tilt)
            self._stage.wait(timeout)

    @property
    def position(self) -> Position:
        """Where the stage reports to be; raises as `go`."""
        with self._final():
            return self._stage.position

    def halt(self) -> None:
        """Stop, because something else has failed; raises as `go`."""
        if self._stage.is_open and not self._stage.needs_home:
            with self._final():
                self._stage.stop()
                if self._stage.uncertainty is not None:
                    raise OperationError(self._stage.uncertainty)

    def home(self) -> None:
        """Find the position, which calling it consents to; raises as `prepare`."""
        self._operator.tell(f"homing {self._stage}: it {self._stage.homing}")
        with self._final():
            self._stage.home()
        self._failed, self._announced = False, None

    def _find_position(self) -> None:
        if self._stage.needs_consent:
            self._require_consent()
        self._homings += 1
        self.home()

    def _require_consent(self) -> None:
        stage = self._stage
        why = f"the position of {stage} is unknown ({stage.uncertainty})"
        if self._home == "never":
            raise MotionError(f'{why}, and stage.home = "never": allow to home it with --home')
        if self._home == "at start" and stage.finds_reference and not self._failed:
            if self._homings > _REHOMINGS:
                raise MotionError(f"{why}, and it was homed {self._homings} times already: find out why")
            return
        question = f"{why}. To find it, it {stage.homing}. Is everybody and everything out of its way?"
        if not self._operator.ask(question, stage.interrupted):
            always = ' (stage.home = "at start" allows it for every start)' if stage.finds_reference else ""
            raise MotionError(
                f"{why}: allow to home it, with `lidarboost stage home` or by starting again with "
                f"--home{always}; it then {stage.homing}"
            )

    def _announce(self, poses: Sequence[Position]) -> None:
        if self._stage.needs_consent:
            here = self.position
            pans, tilts = ([degrees(angle) for angle in axis] for axis in _axes(poses))
            self._operator.tell(
                f"{self._stage} is about to turn from pan {degrees(here.pan):.2f}°, tilt "
                f"{degrees(here.tilt):.2f}° to pan {min(pans):.2f}° to {max(pans):.2f}°, tilt "
                f"{min(tilts):.2f}° to {max(tilts):.2f}°, at most {degrees(self._stage.speed):.1f}°/s"
            )

    @contextmanager
    def _final(self) -> Iterator[None]:
        try:
            yield
        except DeviceLostError:
            raise
        except OperationError as error:
            self._failed = True
            raise MotionError(f"{error}; it stands still until started again") from error


def _axes(poses: Sequence[Position]) -> tuple[list[float], list[float]]:
    return [pose.pan for pose in poses], [pose.tilt for pose in poses]
