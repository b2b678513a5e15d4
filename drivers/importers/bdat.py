"""Binary SR4000 frames as a public recorder writes them, one file each.

z, x, y as float32, then amplitude and confidence as uint16, 144 × 176 each, little endian, row after row. The
times are beside them in `timestamp.log`: lines of a frame's number and seconds. Layout as read by the
public Matlab and C++ tools of that recorder; no such file was at hand.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from drivers.calibration import sr4000_calibration
from drivers.errors import RecordingError
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source
from drivers.importers.points import radial_counts, whole_amplitude

SHAPE = (144, 176)
LAYOUT = np.dtype(
    [
        ("z", "<f4", SHAPE),
        ("x", "<f4", SHAPE),
        ("y", "<f4", SHAPE),
        ("amplitude", "<u2", SHAPE),
        ("confidence", "<u2", SHAPE),
    ]
)
"""405,504 bytes."""

TIMES = "timestamp.log"


def source(path: Path) -> Source:  # noqa: ARG001
    """The camera: an SR4000; its amplitude is in gray mode, as the vendor's defaults have it."""
    return Source("SR4000", None, sr4000_calibration(), 30e6, "gray")


def count(path: Path) -> int:  # noqa: ARG001
    """Frames in a file."""
    return 1


def read(path: Path, options: ImportOptions, findings: Findings) -> Iterator[Exposure]:
    """The one exposure of a file.

    Raises:
        RecordingError: another size, or a time log that cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); name a .bdat frame") from error
    if len(content) != LAYOUT.itemsize:
        raise RecordingError(
            f"{path}: has {len(content):,} bytes, expected {LAYOUT.itemsize:,} (one SR4000 frame): "
            "the file is torn or of another kind; copy it again"
        )
    if options.amplitude_mode is None:
        findings.note("amplitude is taken to be in gray mode, the vendor's default: .bdat does not say")
    frame = np.frombuffer(content, LAYOUT)[0]
    x, y, z, amplitude, confidence = (
        frame[name].astype(np.float64) for name in ("x", "y", "z", "amplitude", "confidence")
    )
    frequency = options.modulation_frequency or source(path).modulation_frequency
    yield Exposure(
        counts=radial_counts(x, y, z, confidence, frequency, path),
        amplitude=whole_amplitude(amplitude, path),
        time=_time(path),
    )


def _time(path: Path) -> int | None:
    """ns of a frame by the number at the end of its name; None where there is no log."""
    log = path.with_name(TIMES)
    number = re.search(r"(\d+)$", path.stem)
    if number is None or not log.exists():
        return None
    try:
        times = {int(index): float(seconds) for index, seconds in map(str.split, _lines(log))}
    except (OSError, ValueError) as error:
        raise RecordingError(f"{log}: expected lines of a frame's number and seconds ({error})") from error
    if int(number[1]) not in times:
        raise RecordingError(f"{log}: has no line for frame {int(number[1])}; complete it or take it away")
    return round(times[int(number[1])] * 1e9)


def _lines(log: Path) -> list[str]:
    return [line for line in log.read_text(encoding="ascii").splitlines() if line.strip()]
