"""Text frames of an SR4000: images of numbers under title lines, and a time.

Titles begin with `%`. The images are z, x, y in metres, amplitude, and mostly confidence (0 = none); a last
title may be followed by a row that begins with the time in milliseconds. An image has one line per row, or
stands on one line altogether. Written by the vendor's software, and without the time by public recorders
(`%%` or `%/` before each title, numbers apart by blanks).
"""

import re
import string
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.importers import numerals
from drivers.importers.cartesian import SHAPE, CartesianFormat, CartesianFrame
from drivers.importers.content import read_bounded
from drivers.importers.exposure import Findings
from drivers.importers.times import nanoseconds

LIMIT = 16 << 20
"""Bytes; real frames have 0.7 MB, 20 digits for each number and two bytes for each character 5 MB."""

TITLE = re.compile(r"^[ \t]*%(.*)$", re.MULTILINE)

SECTIONS = {
    "z": r"distance|\bz",
    "x": r"\bx",
    "y": r"\by",
    "amplitude": r"amplitude|intensity",
    "confidence": r"confidence",
    "time": r"\btime|additional",
}
"""In the usual order, with what their titles say."""

OPTIONAL = ("confidence", "time")


def parse(path: Path, findings: Findings) -> CartesianFrame:  # noqa: ARG001
    """The frame of a text file.

    Raises:
        RecordingError: not such a file, or one that is torn; says which part.
    """
    sections = _sections(path)
    images = {name: _image(rows, name, path) for name, rows in sections.items() if name != "time"}
    shape = images["z"].shape
    for name, image in images.items():
        if image.shape != shape:
            raise RecordingError(
                f"{path}: image {name} has {image.shape[0]} × {image.shape[1]} values, z has "
                f"{shape[0]} × {shape[1]}; expected one size: the file is torn; copy it again"
            )
    time = _time(sections["time"], shape[1], path) if "time" in sections else None
    return CartesianFrame(
        z=images["z"],
        x=images["x"],
        y=images["y"],
        amplitude=images["amplitude"],
        confidence=images.get("confidence"),
        time=time,
    )


FORMAT = CartesianFormat(parse)


def _sections(path: Path) -> dict[str, str]:
    """What stands under each title, as numbers that Python reads."""
    try:
        text = numerals.decode(read_bounded(path, LIMIT, "text frame"))
    except ValueError as error:
        raise RecordingError(f"{path}: is not text; expected an SR4000 text frame") from error
    if not text.strip():
        raise RecordingError(f"{path}: is empty; expected an SR4000 text frame: copy it again")
    before, *parts = TITLE.split(text)
    titles, bodies = parts[::2], parts[1::2]
    if before.strip() or not titles:
        raise RecordingError(f"{path}: does not begin with a title line (`%`); expected an SR4000 text frame")
    comma = numerals.decimal_comma("\n".join(bodies))
    names = [_name(title, place) for place, title in enumerate(titles)]
    found = {name: numerals.plain(body, comma=comma) for name, body in zip(names, bodies, strict=True)}
    missing = [name for name in SECTIONS if name not in found and name not in OPTIONAL]
    if missing or len(found) != len(names) or not found.keys() <= SECTIONS.keys():
        raise RecordingError(
            f"{path}: has {len(titles)} sections ({', '.join(names)}), expected z, x, y, amplitude, and "
            "mostly confidence and a time: the file is torn or of another kind"
        )
    return found


def _name(title: str, place: int) -> str:
    """What a section is by its title, or else by its place."""
    for name, words in SECTIONS.items():
        if re.search(words, title, re.IGNORECASE):
            return name
    return list(SECTIONS)[place] if place < len(SECTIONS) else "unknown"


def _image(text: str, name: str, path: Path) -> NDArray[np.float64]:
    try:
        rows = numerals.rows(text)
    except ValueError as error:
        raise RecordingError(f"{path}: image {name} is torn or garbled ({error}); copy it again") from error
    if not rows:
        raise RecordingError(f"{path}: image {name} has no rows: the file is torn; copy it again")
    lengths = {len(row) for row in rows}
    if len(lengths) == 1 and len(rows) > 1:
        return np.stack(rows)
    values = np.concatenate(rows)
    if values.size == SHAPE[0] * SHAPE[1]:
        return values.reshape(SHAPE)
    raise RecordingError(
        f"{path}: image {name} is torn or garbled ({values.size:,} values in {len(rows)} lines of "
        f"{min(lengths)} to {max(lengths)}); expected {SHAPE[0]} lines of {SHAPE[1]}"
    )


def _time(text: str, columns: int, path: Path) -> int:
    words = text.split()
    if text.endswith(tuple(string.digits)) and len(words) < columns:
        raise RecordingError(f"{path}: ends in the middle of its time: the file is torn; copy it again")
    try:
        return nanoseconds(Decimal(words[0]) * 10**6)
    except (IndexError, ArithmeticError) as error:
        raise RecordingError(
            f"{path}: its last section holds no time in milliseconds: the file is torn; copy it again"
        ) from error
    except ValueError as error:
        raise RecordingError(f"{path}: its time is {words[0]} ms; {error}") from error
