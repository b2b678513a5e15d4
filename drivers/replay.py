"""A camera that plays a recording."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.device import BackendOptions
from drivers.errors import DeviceTimeoutError, EndOfRecordingError, RecordingError
from drivers.frame import Frame
from drivers.recording import Recording, open_recording
from drivers.settings import CameraSettings, Capabilities


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
    consumer that was late gets the next ones at once and none is dropped. Stopping pauses; opening rewinds.
    Settings cannot be changed: they stay as they were recorded.
    """

    Options = ReplayOptions

    @property
    def recording(self) -> Recording:
        """The recording that is played; the camera must be open."""
        self._require_open("read the recording of")
        return self._recording

    def _open(self) -> None:
        self._recording = open_recording(self._replay.path)
        self._frames = self._play()
        self._next: tuple[Frame, Calibration | None] | None = None
        self._shown: Calibration | None = None
        self._settings = _recorded_settings(next(self._recording.frames()))

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
        frame, calibration = self._next
        self._wait_until_due(frame, timeout)
        self._next, self._shown = None, calibration
        return frame

    def _wait_until_due(self, frame: Frame, timeout: float) -> None:
        speed = self._replay.speed
        if speed is None:
            return
        if self._anchor is None:
            self._anchor = self.clock.now(), frame.timestamp
        started, first = self._anchor
        wait = (started + (frame.timestamp - first) / speed - self.clock.now()) / 1e9
        self.clock.sleep(min(wait, timeout))
        if wait > timeout:
            raise DeviceTimeoutError(f"the next recorded frame is due in {wait - timeout:.2f} s; grab again")

    def _play(self) -> Iterator[tuple[Frame, Calibration | None]]:
        """Frames and the calibration of each, None where there is none."""
        for frame in self._recording.frames():
            yield frame, self._calibration_of(frame)
        if not self._replay.loop:
            return
        entries = self._recording.entries
        times = [entry.timestamp for entry in entries]
        span = max(times) - min(times)
        round_time = span + max(1, span // max(1, len(times) - 1))
        counted = 1 + max(entry.sequence for entry in entries) - min(entry.sequence for entry in entries)
        bursts = [entry.burst for entry in entries if entry.burst is not None]
        rounds = 0
        while True:
            rounds += 1
            for frame in self._recording.frames():
                again = replace(
                    frame,
                    timestamp=frame.timestamp + rounds * round_time,
                    sequence=frame.sequence + rounds * counted,
                    burst=None
                    if frame.burst is None
                    else frame.burst + rounds * (1 + max(bursts) - min(bursts)),
                )
                yield again, self._calibration_of(frame)

    def _calibration_of(self, frame: Frame) -> Calibration | None:
        try:
            return self._recording.calibration_of(frame)
        except RecordingError:  # told to who asks for the calibration
            return None

    def _apply(self, settings: CameraSettings) -> CameraSettings:  # noqa: ARG002
        return self._settings

    def _calibration(self) -> Calibration:
        """Of the frame grabbed last: merged recordings hold several."""
        return self._shown or self._recording.calibration

    def _capabilities(self) -> Capabilities:
        known = self._recording.metadata
        return Capabilities(
            shape=self._recording.entries[0].shape,
            source="replay",
            carries_pose=True,
            model=known.get("camera_model", f"recording {self._replay.path.name}"),
            serial=known.get("camera_serial"),
        )

    @property
    def _replay(self) -> ReplayOptions:
        return cast(ReplayOptions, self.options)


def _recorded_settings(frame: Frame) -> CameraSettings:
    """Settings as they were; nominal integration time where the recording does not know it."""
    known = {} if frame.integration_time is None else {"integration_time": frame.integration_time}
    return CameraSettings.model_construct(
        **{
            **CameraSettings().model_dump(),
            **known,
            "modulation_frequency": frame.modulation_frequency,
            "amplitude_mode": frame.amplitude_mode,
        }
    )
