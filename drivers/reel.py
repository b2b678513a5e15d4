"""A recording as it is played: frame after frame on one line of time, round after round."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.recording import Recording, open_recording
from drivers.timeline import Timeline


class Reel:
    """The frames of a recording; those of later rounds of a loop have times and counters that go on rising.

    Args:
        path: the recording, MCAP.

    Raises:
        RecordingError: as `open_recording`.
    """

    def __init__(self, path: Path) -> None:
        self.recording: Recording = open_recording(path)
        entries = self.recording.entries
        self.line = Timeline([entry.timestamp for entry in entries])
        numbers = [entry.sequence for entry in entries]
        bursts = [entry.burst for entry in entries if entry.burst is not None]
        self._end = max(entry.timestamp for entry in entries) + self.line.round - self.line.duration
        self._numbers = 1 + max(numbers) - min(numbers)
        self._bursts = 1 + max(bursts) - min(bursts) if bursts else 0

    def __len__(self) -> int:
        return len(self.line)

    def due(self, frame: int, rounds: int = 0) -> int:
        """When a frame is due, ns after the first of the first round."""
        return rounds * self.line.round + self.line.due(frame)

    def frames(self, first: int = 0, rounds: int = 0) -> Iterator[tuple[int, Frame]]:
        """Frames of a round from `first` on, numbered; raises `RecordingError` where one is unreadable."""
        entries = self.recording.entries[first:]
        for number, frame in enumerate(self.recording.fetch(entries), first):
            yield number, self._again(number, frame, rounds) if rounds else frame

    def calibration(self, frame: int) -> Calibration | None:
        """The calibration of a frame, None where there is none."""
        try:
            return self.recording.calibration_of(self.recording.entries[frame])
        except RecordingError:  # told to who asks for the calibration
            return None

    def _again(self, number: int, frame: Frame, rounds: int) -> Frame:
        return replace(
            frame,
            timestamp=self._end + self.due(number, rounds - 1),
            sequence=frame.sequence + rounds * self._numbers,
            burst=None if frame.burst is None else frame.burst + rounds * self._bursts,
        )
