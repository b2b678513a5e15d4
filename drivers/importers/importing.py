"""Camera files of any known format as frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame, ambiguity_range
from drivers.importers import bdat, srs, text
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source

FRAME_TIME = 32_000_000
"""ns; an SR4000 frame takes 31 to 32 ms, and no format says which instant of it was stamped."""


class Format(Protocol):
    """A file format: whose camera it is, its exposures, and how many there are."""

    def source(self, path: Path) -> Source: ...

    def read(self, path: Path, options: ImportOptions, findings: Findings) -> Iterator[Exposure]: ...

    def count(self, path: Path) -> int: ...


FORMATS: dict[str, Format] = {".srs": srs, ".bdat": bdat, ".dat": text, ".txt": text}
"""By suffix."""


@dataclass
class Import:
    """Frames on their way from files.

    Attributes:
        source: the camera.
        calibration: given, or the model's.
        count: frames to expect, for a progress bar.
        findings: what there is to say; complete once all frames have been taken.
    """

    source: Source
    calibration: Calibration
    count: int
    findings: Findings
    _frames: Callable[[], Iterator[Frame]] = field(repr=False)

    def frames(self) -> Iterator[Frame]:
        """The frames in the order of the files.

        Raises:
            RecordingError: a file that cannot be read, or frames that do not fit each other or the
                calibration; says what was expected.
        """
        return self._frames()


def import_frames(
    paths: Sequence[Path], options: ImportOptions | None = None, frames_per_burst: int | None = None
) -> Import:
    """Read files of one camera.

    Args:
        paths: files of one format; its suffix tells which.
        options: what the files do not say.
        frames_per_burst: None = all frames are one burst.

    Raises:
        RecordingError: no file, several formats, an unknown one, or a camera of which no optics are known.
    """
    told = options or ImportOptions()
    if not paths:
        raise RecordingError("no file to import; name at least one frame")
    form = _format(paths)
    source = form.source(paths[0])
    calibration = told.calibration or source.calibration
    if calibration is None:
        raise RecordingError(
            f"{paths[0]}: nothing is known of the optics of an {source.model}; name a calibration file"
        )
    findings = Findings()
    return Import(
        source=source,
        calibration=calibration,
        count=sum(form.count(path) for path in paths),
        findings=findings,
        _frames=lambda: _frames(form, paths, told, source, calibration, frames_per_burst, findings),
    )


def _format(paths: Sequence[Path]) -> Format:
    for path in paths:
        if path.suffix.lower() not in FORMATS:
            said = (
                "is a folder; name its files" if path.is_dir() else f"cannot be imported as {path.suffix!r}"
            )
            raise RecordingError(
                f"{path}: {said}; known are {', '.join(FORMATS)} (SR4000 text frames end in .dat or .txt)"
            )
    suffixes = {path.suffix.lower() for path in paths}
    if len({id(FORMATS[suffix]) for suffix in suffixes}) > 1:
        raise RecordingError(
            f"files of several formats ({', '.join(sorted(suffixes))}): import each by itself"
        )
    return FORMATS[suffixes.pop()]


def _frames(
    form: Format,
    paths: Sequence[Path],
    options: ImportOptions,
    source: Source,
    calibration: Calibration,
    frames_per_burst: int | None,
    findings: Findings,
) -> Iterator[Frame]:
    frequency = options.modulation_frequency or source.modulation_frequency
    clock = _Times(options.frame_rate, findings)
    exposures = ((path, exposure) for path in paths for exposure in form.read(path, options, findings))
    for sequence, (path, exposure) in enumerate(exposures):
        if exposure.counts.shape != calibration.shape:
            raise RecordingError(
                f"{path}: its frame has {_size(exposure.counts.shape)} pixels, its calibration is for "
                f"{_size(calibration.shape)}: name files and calibration of one camera"
            )
        burst, pose = divmod(sequence, frames_per_burst) if frames_per_burst else (0, sequence)
        yield Frame(
            counts=exposure.counts,
            amplitude=exposure.amplitude,
            timestamp=clock.next(exposure.time, path),
            sequence=sequence,
            pan=0.0,
            tilt=0.0,
            integration_time=options.integration_time,
            modulation_frequency=frequency,
            ambiguity_range=ambiguity_range(frequency),
            amplitude_mode=options.amplitude_mode or source.amplitude_mode,
            timestamp_uncertainty=FRAME_TIME,
            burst=burst,
            pose=pose,
        )


class _Times:
    """Times that rise from frame to frame, whatever files are put after one another."""

    def __init__(self, frame_rate: float | None, findings: Findings) -> None:
        self._period = None if frame_rate is None else round(1e9 / frame_rate)
        self._findings = findings
        self._last: int | None = None
        self._step = FRAME_TIME
        self._offset = 0

    def next(self, time: int | None, path: Path) -> int:
        if time is None:
            if self._period is None:
                raise RecordingError(f"{path}: says no times; give the frame rate (--rate)")
            now = 0 if self._last is None else self._last + self._period
        else:
            now = time + self._offset
            if self._last is not None and now <= self._last:
                self._offset += self._last + self._step - now
                now = self._last + self._step
                self._findings.note(f"the clock starts again at {path.name}; its times follow on the last")
        if self._last is not None:
            self._step = now - self._last
        self._last = now
        return now


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[0]} × {shape[1]}"
