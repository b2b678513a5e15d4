"""Where frames come from at present, told to everybody: the devices, or a recording that stands for them."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.calibration import Calibration
from drivers.recording import Recording
from drivers.settings import Capabilities
from service.capture.head import head_of
from service.capture.played import recording_of, truth_of
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon.fusing import Fusing
from service.messages.events import DevicesOpened, Event, HeadChanged


@dataclass(frozen=True, slots=True)
class _Known:
    camera: Capabilities
    calibration: Calibration
    recording: Recording | None


class Origin:
    """The rig that is shown, and what is known of it: a lost camera cannot be asked.

    Args:
        configuration: as it is now.
        fusing: is told the truth, where there is one.
        emit: takes events.
    """

    def __init__(
        self, configuration: Callable[[], Configuration], fusing: Fusing, emit: Callable[[Event], None]
    ) -> None:
        self._configuration, self._fusing, self._emit = configuration, fusing, emit
        self._known: dict[Rig, _Known] = {}
        self.rig: Rig | None = None

    @property
    def camera(self) -> Capabilities | None:
        """What is shown is; None until something is."""
        return None if self.rig is None else self._known[self.rig].camera

    @property
    def planned(self) -> int | None:
        """Frames of a whole burst: of the plan, or as a recording says; None = it does not."""
        known = None if self.rig is None else self._known[self.rig]
        if known is None or not known.camera.carries_pose:
            return self._configuration().fusion.frames
        return None if known.recording is None else known.recording.planned

    def show(self, rig: Rig, now: int, frames: int | None = None) -> None:
        """From now on frames come from this rig; one that is closed must have been shown before.

        Args:
            rig: open, or lost.
            now: ns since the epoch.
            frames: how many are to come; None = no end is in sight.
        """
        if rig.is_open:
            self._known[rig] = _Known(rig.camera.capabilities, rig.calibration, recording_of(rig.camera))
        known = self._known[rig]
        self.rig = rig
        self._fusing.truth = None
        self.tell_head()
        camera = known.camera
        if known.recording is not None and known.recording.entries:
            now = known.recording.entries[0].timestamp  # what is told of its frames is as old as they are
        self._emit(DevicesOpened(camera.model, camera.source, known.calibration, frames, now))

    def forget(self, rig: Rig) -> None:
        """It will not be shown again."""
        self._known.pop(rig, None)

    def tell_head(self) -> None:
        """What a recording begins with is another now."""
        assert self.rig is not None
        known, configuration = self._known[self.rig], self._configuration()
        self._find_truth(self.rig, known, configuration.fusion.upsampling)
        head = head_of(configuration, known.camera, known.calibration, self._fusing.truth, self.planned)
        self._emit(HeadChanged(head))

    def _find_truth(self, rig: Rig, known: _Known, upsampling: int) -> None:
        truth = self._fusing.truth
        if rig.is_open and (truth is None or truth.shape[0] != upsampling * known.calibration.height):
            self._fusing.truth = truth_of(rig.camera, upsampling)
