"""Devices that do as a script says: tiny frames, faults at given calls, time that passes at once."""

from collections.abc import Callable, Mapping
from math import inf
from typing import ClassVar, Literal

import numpy as np

from drivers import Calibration, Camera, CameraSettings, Capabilities, Frame, Limits, Position, Stage
from drivers.calibration import Intrinsics
from drivers.clock import VirtualClock

PERIOD = 130_000_000
"""ns from frame to frame."""

SHAPE = (4, 6)


class ScriptedCamera(Camera):
    """Runs freely at its period; `grab` gives the frame that was exposed first after the last one given.

    Args:
        clock: virtual.
        faults: by number of the `grab` call (0, 1, ...), what it raises.
        carried: frames to give instead, with their own poses.
    """

    def __init__(
        self,
        clock: VirtualClock,
        faults: Mapping[int, Exception] | None = None,
        carried: list[Frame] | None = None,
    ) -> None:
        super().__init__(clock=clock)
        self.faults = dict(faults or {})
        self.refusals: list[Exception] = []
        self.applied: list[CameraSettings] = []
        self.calls = self.opened = 0
        self.skip = 0
        self.end: Callable[[], Exception] | None = None
        self._carried = carried
        self._number = 0

    def _open(self) -> None:
        if self.refusals:
            raise self.refusals.pop(0)
        self.opened += 1
        self._origin = self.clock.now()
        self._number = 0
        self._left = None if self._carried is None else list(self._carried)

    def _close(self) -> None: ...
    def _start(self) -> None: ...
    def _stop(self) -> None: ...

    def _grab(self, timeout: float) -> Frame:  # noqa: ARG002
        call, self.calls = self.calls, self.calls + 1
        if call in self.faults:
            raise self.faults[call]
        if self._left is not None:
            if not self._left:
                from drivers import EndOfRecordingError

                raise EndOfRecordingError("played to its end")
            return self._left.pop(0)
        number, self._number = self._number, self._number + 1 + self.skip
        # Complete, and so delivered, at the end of its period; never in the future.
        ready = self._origin + (number + 1) * PERIOD
        self.clock.sleep((ready - self.clock.now()) / 1e9)
        return frame(number, ready - PERIOD // 2)

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        self.applied.append(settings)
        return settings

    def _calibration(self) -> Calibration:
        return calibration()

    def _capabilities(self) -> Capabilities:
        source: Literal["device", "replay"] = "device" if self._carried is None else "replay"
        return Capabilities(SHAPE, source, self._carried is not None, "scripted")


class ScriptedStage(Stage):
    """Takes 0.3 s for a movement and reports a position a little off; `faults` by number of the movement."""

    needs_consent: ClassVar[bool] = False

    def __init__(self, clock: VirtualClock, faults: Mapping[int, Exception] | None = None) -> None:
        super().__init__(clock=clock)
        self.faults = dict(faults or {})
        self.moves: list[tuple[float, float]] = []
        self.stops = self.homings = 0
        self._arrival = 0

    def _open(self) -> None: ...
    def _close(self) -> None: ...
    def _home(self) -> None:
        self.homings += 1

    def _homing(self) -> str:
        return "moves nothing"

    def _move_to(self, pan: float, tilt: float) -> None:
        self.moves.append((pan, tilt))
        self._arrival = self.clock.now() + 300_000_000

    def _remaining(self) -> float:
        number = len(self.moves) - 1
        if number in self.faults:
            raise self.faults.pop(number)
        return max(0.0, (self._arrival - self.clock.now()) * 1e-9)

    def _stop(self) -> None:
        self.stops += 1
        self._arrival = 0

    def _position(self) -> Position:
        return Position(self.moves[-1][0] + 1e-5, self.moves[-1][1]) if self.moves else Position(0.0, 0.0)

    def _limits(self) -> Limits:
        return Limits((-1.0, 1.0), (-1.0, 1.0))

    def _speed(self) -> float:
        return 100.0

    def _acceleration(self) -> float:
        return inf


def calibration() -> Calibration:
    return Calibration(
        width=SHAPE[1], height=SHAPE[0], intrinsics=Intrinsics(fx=200.0, fy=200.0, cx=2.5, cy=1.5)
    )


def frame(number: int, timestamp: int = 0, **changes: object) -> Frame:
    values: dict[str, object] = {
        "counts": np.full(SHAPE, 20_000 + number, np.uint16),
        "amplitude": np.full(SHAPE, 2_000, np.uint16),
        "timestamp": timestamp,
        "sequence": number,
        "pan": 0.0,
        "tilt": 0.0,
        "integration_time": 0.030,
        "modulation_frequency": 20e6,
        "ambiguity_range": 7.5,
    }
    return Frame(**{**values, **changes})  # type: ignore[arg-type]
