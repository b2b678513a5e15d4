"""Bursts of frames that already say where they belong."""

from dataclasses import replace

from drivers.bursts import BurstCutter, ExpectedFrames
from drivers.errors import EndOfRecordingError
from drivers.frame import Frame
from service.capture.grabber import Grabber
from service.messages.burst import Burst


class CarriedBursts:
    """Bursts of a camera whose frames bring their own angles, burst and pose (a recording does).

    `BurstCutter` says where one ends, `ExpectedFrames` what it lacks.

    Args:
        grabber: gives frames.
        frames: frames of a burst that has no id.
        planned: frames of any other, where that is known.
    """

    def __init__(self, grabber: Grabber, frames: int, planned: int | None = None) -> None:
        self._grabber, self._rig = grabber, grabber.rig
        self._length = frames
        self._cutter, self._expected = BurstCutter(frames), ExpectedFrames(frames, planned)

    def take(self, number: int) -> Burst:
        first = self._grab_first()
        calibration = self._rig.calibration
        frames = [self._grabber.keep(numbered(first, number, 0))]
        # A burst that is cut by number is complete without a look at the next frame.
        while first.burst is not None or len(frames) < self._length:
            self._grabber.control.between_poses()
            try:
                frame = self._grabber.grab_patiently()
            except EndOfRecordingError:
                break
            if self._begins(frame):
                self._grabber.put_back(frame)
                break
            frames.append(self._grabber.keep(numbered(frame, number, len(frames))))
        expected = self._expected.of(frames) if first.burst is not None else self._length
        self._grabber.counts.bursts += 1
        return Burst(frames[0].burst or 0, tuple(frames), calibration, expected)

    def _grab_first(self) -> Frame:
        frame = self._grabber.grab_patiently()
        self._begins(frame)
        return frame

    def _begins(self, frame: Frame) -> bool:
        return self._cutter.begins(frame, frame.shape, self._rig.calibration)


def numbered(frame: Frame, burst: int, pose: int) -> Frame:
    """A frame with the numbers of its burst and pose, where it has none of its own."""
    return replace(
        frame,
        burst=frame.burst if frame.burst is not None else burst,
        pose=frame.pose if frame.pose is not None else pose,
    )
