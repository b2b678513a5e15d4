"""What an importer has found: a camera, and its frames on their way."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.importers.exposure import Findings, Source


@dataclass
class Import:
    """Frames on their way from files.

    Attributes:
        source: the camera.
        calibration: given, or the files' own, or the model's.
        optics_residual: pixels, of the fit of `calibration` to the files; None = it was not fitted.
        count: frames to expect, for a progress bar.
        findings: what there is to say; complete once all frames have been taken.
    """

    source: Source
    calibration: Calibration
    optics_residual: float | None
    count: int
    findings: Findings
    _frames: Callable[[], Iterator[Frame]] = field(repr=False)

    def frames(self) -> Iterator[Frame]:
        """The frames in their order.

        Raises:
            RecordingError: a file that cannot be read, or frames that do not fit each other or the
                calibration; says what was expected.
        """
        return self._frames()
