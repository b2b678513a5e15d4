"""A rig of scripted devices, captured from."""

from threading import Event

from scripted import ScriptedCamera, ScriptedStage

from drivers import Frame, Position
from drivers.clock import VirtualClock
from service.capture.carried import CarriedBursts
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.rig import Rig
from service.capture.scan import ScanBursts
from service.capture.series import Capture
from service.config.sections import PlanSection
from service.messages.burst import Burst
from service.planning.plan import make_plan

SETTLE = 0.05


class FrozenStage(ScriptedStage):
    """Says that it arrives, and reports 0° for ever."""

    def _position(self) -> Position:
        return Position(0.0, 0.0)


class Scene:
    """A rig of scripted devices, and what the capture showed."""

    def __init__(
        self,
        camera_faults=None,
        stage_faults=None,
        carried=None,
        frames=5,
        settings=None,
        kind=ScriptedStage,
    ) -> None:
        self.clock = VirtualClock(1_000_000_000)
        self.camera = ScriptedCamera(self.clock, camera_faults, carried)
        self.stage = kind(self.clock, stage_faults)
        self.rig = Rig(self.camera, self.stage, self.clock, settings)
        self.rig.open()
        self.stop = Event()
        self.shown: list[Frame] = []
        self.grabber = Grabber(self.rig, 2.0, Control(self.stop), self.shown.append)
        if carried is None:
            self.plan = make_plan(PlanSection(), frames, self.rig.calibration.intrinsics)
            bursts = ScanBursts(self.grabber, self.plan, SETTLE, 10.0)
        else:
            bursts = CarriedBursts(self.grabber, frames)
        self.capture = Capture(self.grabber, bursts)

    @property
    def counts(self):
        return self.capture.counts

    def take(self, count: int) -> list[Burst]:
        found = []
        for burst in self.capture.run():
            found.append(burst)
            if len(found) == count:
                break
        return found
