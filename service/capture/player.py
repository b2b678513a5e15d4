"""Plays a recording as it is told: on, not on, elsewhere, faster, or a step."""

from bisect import bisect_right
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from itertools import accumulate

from drivers.bursts import ExpectedFrames
from drivers.calibration import Calibration
from drivers.clock import Clock, SystemClock
from drivers.errors import EndOfRecordingError
from drivers.frame import Frame
from drivers.recording import Recording
from drivers.reel import Reel
from service.messages.report import BurstReport

Stepped = Future[BurstReport | None]
"""The report of the last map of a step; None where it has none."""


class BurstTable:
    """Which frames make which burst of a recording.

    Args:
        recording: open.
        frames: frames of a burst that has no id.
    """

    def __init__(self, recording: Recording, frames: int) -> None:
        cut = recording.cut(frames)
        expected = ExpectedFrames(frames, recording.planned)
        self.expected = tuple(expected.of([entry.fields for entry in burst]) for burst in cut)
        self._starts = tuple(accumulate(map(len, cut), initial=0))

    def __len__(self) -> int:
        return len(self.expected)

    def of(self, frame: int) -> int:
        """The burst of a frame; beyond the last frame the last burst."""
        return min(len(self) - 1, bisect_right(self._starts, frame) - 1)

    def first(self, burst: int) -> int:
        """Its first frame."""
        return self._starts[burst]

    def end(self, burst: int) -> int:
        """The frame after its last one."""
        return self._starts[burst + 1]


@dataclass(frozen=True, slots=True)
class Shot:
    """A frame that was played.

    Attributes:
        number: of the frame in the recording, from 0.
        frame: as recorded; in later rounds with later times.
        calibration: that belongs to it.
        rounds: how often the recording had begun again.
        is_last: of a step.
    """

    number: int
    frame: Frame
    calibration: Calibration
    rounds: int
    is_last: bool


class Player:
    """Where a recording is, and where it goes next; for one thread, others may look.

    With a speed, each frame is due at its own time after the one with which it went on: a consumer that was
    late gets the next ones at once, and none is dropped.

    Args:
        reel: the frames.
        frames: frames of a burst that has no id.
        speed: times real time; None = as fast as frames are taken.
        loop: begin again at the end.
        playing: go on by itself.
        calibration: replaces the recorded ones.
        clock: real time.

    Attributes:
        at: the next frame; behind the last one = at the end.
        rounds: how often it has begun again.
        sought: set where it was sent elsewhere; whoever takes the frames begins anew, and resets it.
        stepped: told what came of the step at work.
    """

    def __init__(
        self,
        reel: Reel,
        frames: int,
        *,
        speed: float | None = 1.0,
        loop: bool = False,
        playing: bool = False,
        calibration: Calibration | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.reel = reel
        self.bursts = BurstTable(reel.recording, frames)
        self.speed, self.loop, self.playing = speed, loop, playing
        self.at = self.rounds = 0
        self.sought = False
        self.stepped: Stepped | None = None
        self._left = 0
        self._calibration = calibration
        self._clock = clock if clock is not None else SystemClock()
        self._anchor: tuple[int, int] | None = None
        self._frames: Iterator[tuple[int, Frame]] | None = None

    @property
    def ended(self) -> bool:
        """Whether the last frame was taken."""
        return self.at == len(self.reel)

    @property
    def stepping(self) -> bool:
        """Whether frames of a step are left."""
        return self._left > 0

    @property
    def burst(self) -> int:
        """The burst of the next frame."""
        return self.bursts.of(self.at)

    @property
    def seconds(self) -> float:
        """Where it is, seconds from the first frame."""
        return self.reel.due(min(self.at, len(self.reel) - 1)) / 1e9

    @property
    def at_burst(self) -> bool:
        """Whether the next frame begins a burst."""
        return self.ended or self.at == self.bursts.first(self.burst)

    def cut(self, frames: int) -> None:
        """Cut bursts that have no id into so many frames from now on."""
        self.bursts = BurstTable(self.reel.recording, frames)

    def play(self) -> None:
        """Go on; from the beginning where it was at the end."""
        if self.ended:
            self.seek(0)
        if not self.playing:
            self._left, self._anchor = 0, None
        self.playing = True

    def pause(self) -> None:
        """Stand still."""
        self.playing, self._left = False, 0

    def set_speed(self, speed: float | None) -> None:
        """Play faster or slower from here on."""
        self.speed, self._anchor = speed, None

    def seek(self, frame: int) -> None:
        """Have that frame come next."""
        self.at, self.rounds = frame, 0
        self._frames = self._anchor = None
        self._left = 0
        self.sought = True

    def step(self, frames: int) -> None:
        """Take that many frames, at once, but none beyond the last; and stand still then."""
        self.playing, self._left = False, min(frames, len(self.reel) - self.at)

    def frames_of_bursts(self, count: int) -> int:
        """How many frames it is to the end of this burst, or of as many as `count`."""
        last = min(self.burst + count, len(self.bursts)) - 1
        return self.bursts.end(last) - self.at

    def wait(self) -> float | None:
        """Seconds until the next frame is due, ≤ 0 = now; None = it stands still."""
        if self._left > 0:
            return 0.0
        if not self.playing:
            return None
        if self.speed is None:
            return 0.0
        due, now = self.reel.due(self.at, self.rounds), self._clock.now()
        if self._anchor is None:
            self._anchor = now, due
        began, first = self._anchor
        return (began + (due - first) / self.speed - now) / 1e9

    def take(self) -> Shot:
        """The next frame.

        Raises:
            RecordingError: it cannot be read.
            EndOfRecordingError: there is none.
        """
        if self.ended:
            raise EndOfRecordingError(f"{self.reel.recording.path} has been played to its end")
        number, frame = self._fetch()
        recording = self.reel.recording
        calibration = self._calibration or recording.calibration_of(recording.entries[number])
        rounds = self.rounds
        self._left = max(0, self._left - 1)
        is_last = self._left == 0 and not self.playing
        self._advance()
        return Shot(number, frame, calibration, rounds, is_last)

    def _fetch(self) -> tuple[int, Frame]:
        frames, self._frames = self._frames, None  # one that fails is not asked again
        if frames is None:
            frames = self.reel.frames(self.at, self.rounds)
        found = next(frames)
        self._frames = frames
        return found

    def _advance(self) -> None:
        self.at += 1
        if not self.ended:
            return
        self._frames = None
        if self.loop:
            self.at, self.rounds = 0, self.rounds + 1
        else:
            self.playing = False
