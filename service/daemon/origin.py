"""Where frames come from at present, told to everybody: the devices, or a recording that stands for them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.recording import Recording, RecordingHead
from drivers.settings import Capabilities
from service.capture.head import head_of
from service.capture.played import recording_of, truth_finder
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon.fusing import Fusing
from service.daemon.truth_search import TruthSearch
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
        self._search = TruthSearch()
        self._sought: tuple[Rig, int] | None = None
        self._make_head: Callable[[NDArray[np.float32] | None], RecordingHead]
        self._telling = Lock()

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
        is_first = self.rig is None
        if rig.is_open:
            self._known[rig] = _Known(rig.camera.capabilities, rig.calibration, recording_of(rig.camera))
        known = self._known[rig]
        with self._telling:
            self.rig, self._sought, self._fusing.truth = rig, None, None
        self.tell_head(wait=is_first)
        camera = known.camera
        if known.recording is not None and known.recording.entries:
            now = known.recording.entries[0].timestamp  # what is told of its frames is as old as they are
        self._emit(DevicesOpened(camera.model, camera.source, known.calibration, frames, now))

    def forget(self, rig: Rig) -> None:
        """It will not be shown again."""
        self._known.pop(rig, None)

    def tell_head(self, *, wait: bool = False) -> None:
        """What a recording begins with is another now; once more when a simulation's truth is rendered.

        Args:
            wait: until it is.
        """
        assert self.rig is not None
        known, configuration = self._known[self.rig], self._configuration()
        with self._telling:
            self._make_head = partial(
                head_of, configuration, known.camera, known.calibration, frames_per_burst=self.planned
            )
            self._find_truth(self.rig, known, configuration.fusion.upsampling, wait=wait)
            self._emit(HeadChanged(self._make_head(self._fusing.truth)))

    def _find_truth(self, rig: Rig, known: _Known, upsampling: int, *, wait: bool) -> None:
        truth = self._fusing.truth
        fits = truth is not None and truth.shape[0] == upsampling * known.calibration.height
        if not rig.is_open or fits or self._sought == (rig, upsampling):
            return
        find = truth_finder(rig.camera, upsampling)
        if wait or known.camera.source != "simulation":
            self._fusing.truth = find()
            return
        self._fusing.truth, self._sought = None, (rig, upsampling)
        self._search.begin(find, partial(self._found, self._sought))

    def _found(self, sought: tuple[Rig, int], truth: NDArray[np.float32] | None) -> None:
        with self._telling:
            if sought == self._sought:
                self._fusing.truth, self._sought = truth, None
                self._emit(HeadChanged(self._make_head(truth)))
