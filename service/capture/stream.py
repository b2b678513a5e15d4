"""The frames of a stream: every one as it comes."""

from drivers.frame import Frame
from service.capture.grabber import Grabber
from service.capture.scan import ScanBursts
from service.planning.plan import Plan


class SweptFrames:
    """Frames of a camera that a stage takes through a plan again and again, or of one at rest."""

    def __init__(self, poses: ScanBursts, plan: Plan) -> None:
        self._poses, self._length = poses, len(plan)

    def take(self, number: int) -> Frame:
        return self._poses.frame(None, number % self._length)


class CarriedFrames:
    """Frames of a camera that brings its own angles, as a recording does."""

    def __init__(self, grabber: Grabber) -> None:
        self._grabber = grabber

    def take(self, number: int) -> Frame:  # noqa: ARG002
        self._grabber.control.between_poses()
        return self._grabber.keep(self._grabber.grab_patiently())
