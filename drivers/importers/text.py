"""Text frames of an SR4000: five images of numbers and a time.

Each image is a title line that begins with `%` and one line per row: z, x, y in metres, amplitude, confidence
0 to 7. A last title is followed by a row that begins with the time in milliseconds.
"""

from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import sr4000_calibration
from drivers.errors import RecordingError
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source
from drivers.importers.points import direction_error, radial_counts, whole_amplitude

IMAGES = ("z", "x", "y", "amplitude", "confidence")

WRONG_DIRECTIONS = 1.0
"""Pixels; real frames agree with their calibration within 0.1."""


def source(path: Path) -> Source:  # noqa: ARG001
    """The camera: the format is known of the SR4000 alone."""
    return Source("SR4000", None, sr4000_calibration(), 30e6, "gray")


def count(path: Path) -> int:  # noqa: ARG001
    """Frames in a file."""
    return 1


def read(path: Path, options: ImportOptions, findings: Findings) -> Iterator[Exposure]:
    """The one exposure of a text frame.

    Raises:
        RecordingError: not such a file, or one that is torn; says which part.
    """
    images, time = _parse(path)
    x, y, z = images["x"], images["y"], images["z"]
    known = source(path)
    frequency = options.modulation_frequency or known.modulation_frequency
    calibration = options.calibration or sr4000_calibration()
    if calibration.shape == z.shape:
        off = direction_error(x, y, z, calibration)
        if off is not None and off > WRONG_DIRECTIONS:
            findings.note(
                f"points of {path.name} lie {off:.1f} pixels (median) from where the calibration puts them: "
                "check that it is this camera's"
            )
    yield Exposure(
        counts=radial_counts(x, y, z, images["confidence"], frequency, path),
        amplitude=whole_amplitude(images["amplitude"], path),
        time=round(time * 1e6),
    )


def _parse(path: Path) -> tuple[dict[str, NDArray[np.float64]], float]:
    try:
        text = path.read_text(encoding="ascii")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); name a text frame") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: is not text; expected an SR4000 text frame") from error
    if not text.strip():
        raise RecordingError(f"{path}: is empty; expected an SR4000 text frame: copy it again")
    before, *sections = ("\n" + text).split("\n%")
    if before.strip() or not sections:
        raise RecordingError(f"{path}: does not begin with a title line (`%`); expected an SR4000 text frame")
    if len(sections) != len(IMAGES) + 1:
        raise RecordingError(
            f"{path}: has {len(sections)} sections, expected {len(IMAGES)} images and a time: "
            "the file is torn or of another kind; copy it again"
        )
    images = {name: _image(section, name, path) for name, section in zip(IMAGES, sections, strict=False)}
    shape = images["z"].shape
    for name, image in images.items():
        if image.shape != shape:
            raise RecordingError(
                f"{path}: image {name} has {image.shape[0]} × {image.shape[1]} values, z has "
                f"{shape[0]} × {shape[1]}; expected one size: the file is torn; copy it again"
            )
    return images, _time(sections[-1], path)


def _image(section: str, name: str, path: Path) -> NDArray[np.float64]:
    _, _, rows = section.partition("\n")
    if not rows.strip():
        raise RecordingError(f"{path}: image {name} has no rows: the file is torn; copy it again")
    try:
        return np.loadtxt(StringIO(rows), dtype=np.float64, ndmin=2)
    except ValueError as error:
        raise RecordingError(f"{path}: image {name} is torn or garbled ({error}); copy it again") from error


def _time(section: str, path: Path) -> float:
    values = section.partition("\n")[2].split()
    try:
        time = float(values[0])
    except (IndexError, ValueError) as error:
        raise RecordingError(
            f"{path}: its last section holds no time in milliseconds: the file is torn; copy it again"
        ) from error
    if not np.isfinite(time):
        raise RecordingError(f"{path}: its time is {time}; expected milliseconds")
    return time
