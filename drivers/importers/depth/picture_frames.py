"""Frames of picture files, one picture each."""

import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.importers.depth.framing import MANY, Framing, Image, depth_source
from drivers.importers.depth.pictures import picture_files, read_picture
from drivers.importers.exposure import Findings, ImportOptions
from drivers.importers.found import Import
from drivers.importers.times import Times

_SECONDS = re.compile(r"\d{9,10}\.\d+")
_NANOSECONDS = re.compile(r"1\d{18}")


def import_pictures(
    paths: Sequence[Path], options: ImportOptions, frames_per_burst: int | None, findings: Findings
) -> Import:
    """Pictures of one depth camera, in the natural order of their names.

    Times are those of the names where all are numbers that can be such (seconds with a fraction, or
    nanoseconds), else counted by the frame rate. Amplitude pictures have the depth picture's name, in
    another folder.

    Raises:
        RecordingError: no optics or no scale is told, or the kind of depth.
    """
    files = picture_files(paths)
    if options.calibration is None:
        raise RecordingError(
            f"{files[0]}: nothing is known of the optics behind pictures; name a calibration file "
            "(--calibration; TOML with width, height and intrinsics)"
        )
    framing = Framing(options.calibration, options, frames_per_burst)
    first = _first(files)
    if first.dtype.kind != "f" and options.reading.scale is None:
        raise RecordingError(
            f"{files[0]}: whole numbers ({first.dtype}) of an unknown unit; say what 1 stands for, in "
            "metres: --scale 0.001 for millimetres, 0.0002 for the TUM data sets"
        )
    if options.reading.scale is None:
        findings.note("floating values are taken to be metres")
    lights = None if options.amplitude is None else Path(options.amplitude)
    if lights is not None and not lights.is_dir():
        raise RecordingError(f"{lights}: is no folder; name that of the amplitude pictures")
    if frames_per_burst is None and len(files) > MANY:
        findings.note(f"all {len(files)} frames are one burst, more than can be fused at once: give --burst")
    return Import(
        source=depth_source("depth camera", options.calibration, options),
        calibration=options.calibration,
        optics_residual=None,
        count=len(files),
        findings=findings,
        _frames=lambda: _frames(files, lights, framing, options, findings),
    )


def _first(files: Sequence[Path]) -> NDArray[Any]:
    """The first picture that can be read; raises what is wrong with the first of all where none can."""
    reason = None
    for file in files:
        try:
            return read_picture(file)
        except RecordingError as error:
            reason = reason or error
    assert reason is not None
    raise reason


def _frames(
    files: Sequence[Path],
    lights: Path | None,
    framing: Framing,
    options: ImportOptions,
    findings: Findings,
) -> Iterator[Frame]:
    named = [_named_time(file.stem) for file in files]
    told = all(time is not None for time in named)
    if told:
        findings.note("times are taken from the names of the files")
    clock = Times(options.frame_rate, findings)
    for file, time in zip(files, named, strict=True):
        at = clock.next(time if told else None, file)
        try:
            light = None if lights is None else read_picture(_beside(file, lights))
            yield framing.frame(Image(read_picture(file), light), at, (0.0, 0.0))
        except RecordingError as error:
            findings.lose(f"{file}: left out: {str(error).removeprefix(f'{file}: ')}")


def _beside(file: Path, folder: Path) -> Path:
    same = [other for other in folder.glob(f"{file.stem}.*") if other.stem == file.stem]
    if len(same) != 1:
        raise RecordingError(f"{folder} holds {len(same)} pictures of its name; expected one")
    return same[0]


def _named_time(stem: str) -> int | None:
    """ns since the epoch in a file's name, or None."""
    if _SECONDS.fullmatch(stem):
        return int(Decimal(stem) * 10**9)
    return int(stem) if _NANOSECONDS.fullmatch(stem) else None
