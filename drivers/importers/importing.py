"""Camera files of any known format as frames."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame, ambiguity_range
from drivers.importers import bdat, srs, text
from drivers.importers.depth.bag import SUFFIXES as BAG_SUFFIXES
from drivers.importers.depth.bag import is_bag
from drivers.importers.depth.bag_frames import import_bag
from drivers.importers.depth.picture_frames import import_pictures
from drivers.importers.depth.pictures import SUFFIXES as PICTURE_SUFFIXES
from drivers.importers.depth.pictures import is_picture
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source, check_size
from drivers.importers.found import Import
from drivers.importers.natural import natural
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


def import_frames(
    paths: Sequence[Path], options: ImportOptions | None = None, frames_per_burst: int | None = None
) -> Import:
    """Read files of one camera.

    Args:
        paths: files of one format, which their suffix tells, and of one camera, or folders of them; they are
            taken in the natural order of their names.
        options: what the files do not say.
        frames_per_burst: None = all frames are one burst.

    Raises:
        RecordingError: no file, several formats, an unknown one, or a camera of which no optics are known.
    """
    told = options or ImportOptions()
    if not paths:
        raise RecordingError("no file to import; name at least one frame")
    findings = Findings()
    if all(map(is_bag, paths)):
        return import_bag(paths, told, frames_per_burst, findings)
    if all(map(is_picture, paths)):
        return import_pictures(paths, told, frames_per_burst, findings)
    form = _format(paths)
    ordered = sorted(paths, key=natural)
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


def _format(paths: Sequence[Path]) -> Format:
    for path in paths:
        if path.suffix.lower() not in FORMATS:
            if path.is_dir():
                raise RecordingError(
                    f"{path}: is a folder without bag or pictures; name files or another one"
                )
            known = ", ".join([*FORMATS, *BAG_SUFFIXES, *PICTURE_SUFFIXES])
            raise RecordingError(
                f"{path}: cannot be imported as {path.suffix!r}; known are {known} (SR4000 text frames end "
                "in .dat or .txt)"
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
    frequency = source.carrier(options)
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
