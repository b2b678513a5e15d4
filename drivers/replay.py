"""A camera that plays a recording."""

import logging
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import cast

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.device import BackendOptions
from drivers.errors import DeviceTimeoutError, EndOfRecordingError
from drivers.frame import Frame
from drivers.names import shown
from drivers.recording import Recording
from drivers.reel import Reel
from drivers.settings import CameraSettings, Capabilities, recorded_settings

_TOLD = 5
"""Gaps that are told one by one."""

_log = logging.getLogger(__name__)


class ReplayOptions(BackendOptions):
    """Which recording, and how it is played."""

    path: Path = Field(description="The recording, MCAP.")
    speed: float | None = Field(
        None, gt=0, le=1000, description="Times real time; none = each frame as soon as it is asked for."
    )
    loop: bool = Field(False, description="Begin again at the end; times and counters go on rising.")


class ReplayCamera(Camera):
    """Plays the frames of a recording, unchanged but for the rounds of a loop.

    With a speed, each frame is due at its own time after the first, whatever became of those before: a
    consumer that was late gets the next ones at once and none is dropped. A gap of the recording's clock is
    told and cut short (`Timeline`). Stopping pauses; opening rewinds. Settings cannot be changed: they stay
    as they were recorded.
    """

    Options = ReplayOptions

    @property
    def speed(self) -> float | None:
        """Times real time; None = each frame as soon as it is asked for."""
        return self._replay.speed

    @property
    def loops(self) -> bool:
        """Whether it begins again at the end."""
        return self._replay.loop

    @property
    def recording(self) -> Recording:
        """The recording that is played; the camera must be open."""
        return self.reel.recording

    @property
    def reel(self) -> Reel:
        """The frames of the recording; the camera must be open."""
        self._require_open("read the recording of")
        return self._reel

    def _open(self) -> None:
        self._reel = Reel(self._replay.path)
        for gap in self._reel.line.gaps[:_TOLD]:
            _log.warning("%s: %s; cut short where it is played", self._replay.path, gap)
        self._frames = self._play()
        self._next: tuple[int, Frame, int] | None = None
        self._shown: Calibration | None = None
        self._settings = recorded_settings(next(self._reel.recording.frames()))

    def _close(self) -> None:
        self._frames = iter(())
        self._next = None

    def _start(self) -> None:
        self._anchor: tuple[int, int] | None = None

    def _stop(self) -> None:
        pass

    def _grab(self, timeout: float) -> Frame:
        if self._next is None:
            self._next = next(self._frames, None)
        if self._next is None:
            raise EndOfRecordingError(
                f"{self._replay.path} has been played to its end; open it to play it again"
            )
        due, frame, number = self._next
        self._wait_until(due, timeout)
        self._next, self._shown = None, self._reel.calibration(number)
        return frame

    def _wait_until(self, due: int, timeout: float) -> None:
        speed = self._replay.speed
        if speed is None:
            return
        if self._anchor is None:
            self._anchor = self.clock.now(), due
        started, first = self._anchor
        wait = (started + (due - first) / speed - self.clock.now()) / 1e9
        self.clock.sleep(min(wait, timeout))
        if wait > timeout:
            raise DeviceTimeoutError(f"the next recorded frame is due in {wait - timeout:.2f} s; grab again")

    def _play(self) -> Iterator[tuple[int, Frame, int]]:
        """When each frame is due, the frame, and its number in the recording."""
        for rounds in count() if self._replay.loop else (0,):
            for number, frame in self._reel.frames(rounds=rounds):
                yield self._reel.due(number, rounds), frame, number

    def _apply(self, settings: CameraSettings) -> CameraSettings:  # noqa: ARG002
        return self._settings

    def _calibration(self) -> Calibration:
        """Of the frame grabbed last: merged recordings hold several."""
        return self._shown or self._reel.recording.calibration

    def _capabilities(self) -> Capabilities:
        known = self._reel.recording.metadata
        return Capabilities(
            shape=self._reel.recording.entries[0].shape,
            source="replay",
            carries_pose=True,
            model=known.get("camera_model", f"recording {shown(self._replay.path.name)}"),
            serial=known.get("camera_serial"),
        )

    @property
    def _replay(self) -> ReplayOptions:
        return cast(ReplayOptions, self.options)
