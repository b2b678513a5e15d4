"""Camera files of any known format as frames."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame, ambiguity_range
from drivers.importers import bdat, srs, text
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source, check_size
from drivers.importers.times import FRAME_TIME, Times


class Format(Protocol):
    """A file format: whose camera it is, its exposures, and how many there are."""

    def source(self, paths: Sequence[Path], options: ImportOptions, findings: Findings) -> Source: ...

    def read(
        self, paths: Sequence[Path], source: Source, options: ImportOptions, findings: Findings
    ) -> Iterator[tuple[Path, Exposure]]: ...

    def count(self, path: Path) -> int: ...


FORMATS: dict[str, Format] = {
    ".srs": srs.FORMAT,
    ".bdat": bdat.FORMAT,
    ".bin": bdat.FORMAT,
    ".dat": text.FORMAT,
    ".txt": text.FORMAT,
}
"""By suffix."""


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
        """The frames, file after file in the natural order of their names.

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
        paths: files of one format, which their suffix tells, and of one camera; they are taken in the natural
            order of their names.
        options: what the files do not say.
        frames_per_burst: None = all frames are one burst.

    Raises:
        RecordingError: no file, several formats, an unknown one, or a camera of which no optics are known.
    """
    told = options or ImportOptions()
    if not paths:
        raise RecordingError("no file to import; name at least one frame")
    form = _format(paths)
    findings = Findings()
    ordered = sorted(paths, key=_natural)
    if ordered != list(paths):
        findings.note("files are taken in the natural order of their names: 2 before 10")
    source = form.source(ordered, told, findings)
    calibration = told.calibration or source.calibration
    if calibration is None:
        raise RecordingError(
            f"{paths[0]}: nothing is known of the optics of an {source.model}; name a calibration file"
        )
    return Import(
        source=source,
        calibration=calibration,
        optics_residual=None if told.calibration else source.optics_residual,
        count=sum(form.count(path) for path in paths),
        findings=findings,
        _frames=lambda: _frames(form, ordered, told, source, calibration, frames_per_burst, findings),
    )


def _natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorts numbers inside names by their value."""
    parts = re.split(r"(\d+)", str(path))
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], str(path)


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
    clock = Times(options.frame_rate, findings)
    for sequence, (path, exposure) in enumerate(form.read(paths, source, options, findings)):
        check_size(exposure.counts.shape, calibration, path)
        burst, pose = divmod(sequence, frames_per_burst) if frames_per_burst else (0, sequence)
        yield Frame(
            counts=exposure.counts,
            amplitude=exposure.amplitude,
            timestamp=clock.next(exposure.time, path),
            sequence=sequence,
            pan=0.0,
            tilt=0.0,
            integration_time=options.integration_time or exposure.integration_time,
            modulation_frequency=frequency,
            ambiguity_range=ambiguity_range(frequency),
            amplitude_mode=options.amplitude_mode or source.amplitude_mode,
            timestamp_uncertainty=FRAME_TIME,
            burst=burst,
            pose=pose,
        )
