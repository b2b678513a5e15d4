"""Binary SR4000 frames as public recorders write them, one file each.

Little endian, row after row, 144 × 176. Either z, x, y as float32 in metres, then amplitude and confidence
as uint16; or, in a newer version of the recorder, amplitude, then z in millimetres, 16 bits each. The times
are beside them in `timestamp.log`: lines of a frame's number and seconds.
"""

import re
from decimal import Decimal
from functools import lru_cache
from pathlib import Path

import numpy as np

from drivers.errors import RecordingError
from drivers.importers.cartesian import SHAPE, CartesianFormat, CartesianFrame
from drivers.importers.content import read_bounded
from drivers.importers.exposure import Findings
from drivers.importers.times import nanoseconds

POINTS = np.dtype(
    [
        ("z", "<f4", SHAPE),
        ("x", "<f4", SHAPE),
        ("y", "<f4", SHAPE),
        ("amplitude", "<u2", SHAPE),
        ("confidence", "<u2", SHAPE),
    ]
)
"""405,504 bytes."""

DEPTH = np.dtype([("amplitude", "<u2", SHAPE), ("z", "<i2", SHAPE)])
"""101,376 bytes. A rejected pixel's z is −10 mm, the projection centre seen from the vendor's origin."""

TIMES = "timestamp.log"
LONGEST_LOG = 64 << 20


def parse(path: Path, findings: Findings) -> CartesianFrame:
    """The frame of a binary file.

    Raises:
        RecordingError: another size, or a time log that cannot be read.
    """
    content = read_bounded(path, POINTS.itemsize, "binary frame")
    if len(content) == POINTS.itemsize:
        frame = np.frombuffer(content, POINTS)[0]
        x, y, z, amplitude, confidence = (
            frame[name].astype(np.float64) for name in ("x", "y", "z", "amplitude", "confidence")
        )
        return CartesianFrame(z, x, y, amplitude, confidence, _time(path))
    if len(content) == DEPTH.itemsize:
        frame = np.frombuffer(content, DEPTH)[0]
        findings.note("two images of 16 bits are taken to be amplitude, then z in millimetres")
        z = np.where(frame["z"] > 0, frame["z"] / 1e3, np.nan)
        amplitude = frame["amplitude"].astype(np.float64)
        return CartesianFrame(z, None, None, amplitude, None, _time(path))
    raise RecordingError(
        f"{path}: has {len(content):,} bytes, expected {POINTS.itemsize:,} (z, x, y, amplitude, confidence) "
        f"or {DEPTH.itemsize:,} (amplitude, z in mm): the file is torn or of another kind"
    )


FORMAT = CartesianFormat(parse)


def _time(path: Path) -> int | None:
    """ns of a frame by the number at the end of its name; None where there is no log."""
    log = path.with_name(TIMES)
    number = re.search(r"(\d+)$", path.stem)
    if number is None or not log.exists():
        return None
    times = _times(log, log.stat().st_mtime_ns)
    if int(number[1]) not in times:
        raise RecordingError(f"{log}: has no line for frame {int(number[1])}; complete it or take it away")
    return times[int(number[1])]


@lru_cache(maxsize=1)
def _times(log: Path, changed: int) -> dict[int, int]:  # noqa: ARG001 — a changed log is read anew
    times: dict[int, int] = {}
    for line in read_bounded(log, LONGEST_LOG, "time log").decode("utf-8-sig", "replace").splitlines():
        if not line.strip():
            continue
        try:
            index, seconds = line.split()
            time = nanoseconds(Decimal(seconds) * 10**9)
            number = int(index)
        except (ArithmeticError, ValueError) as error:
            raise RecordingError(
                f"{log}: expected lines of a frame's number and seconds, got {line[:60]!r}"
            ) from error
        if times.setdefault(number, time) != time:
            raise RecordingError(f"{log}: has two times for frame {number}; take the wrong one away")
    return times
