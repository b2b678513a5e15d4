"""Streams of the vendor's Windows software (`.srs`): objects of an id, a size and a payload.

The container is documented by the vendor. That a frame's payload is the sensor's raw output, distance then
amplitude, is inferred from the size of the data on the wire; no such file was at hand.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from drivers.calibration import Calibration, sr3000_calibration, sr4000_calibration
from drivers.errors import RecordingError
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source

SIGNATURES = (b"srIO", b"OIrs")
"""The same constant as compilers of either habit lay it down."""

VERSION = 1
INIT, FRAME = 1, 3
INIT_SIZE = 20
OBJECT_HEADER = 8


@dataclass(frozen=True, slots=True)
class _Model:
    name: str
    shape: tuple[int, int]
    modulation_frequency: float
    calibration: Callable[[], Calibration] | None


MODELS = {
    0x0071: _Model("SR2", (124, 160), 20e6, None),
    0x0074: _Model("SR3000", (144, 176), 20e6, sr3000_calibration),
    0x0075: _Model("SR4000", (144, 176), 30e6, sr4000_calibration),
}
"""By USB product id, with which the first object names the camera."""


def source(path: Path) -> Source:
    """The camera that the stream's first object names; raises `RecordingError` as `read`."""
    with _open(path) as file:
        model, serial = _camera(path, file)
    calibration = model.calibration() if model.calibration else None
    return Source(model.name, serial, calibration, model.modulation_frequency, "linear")


def count(path: Path) -> int:
    """Frames in a stream, about: its size tells."""
    with _open(path) as file:
        model, _ = _camera(path, file)
        return path.stat().st_size // (_frame_size(model) + OBJECT_HEADER)


def read(path: Path, options: ImportOptions, findings: Findings) -> Iterator[Exposure]:
    """The exposures of a stream, without times: the format has none.

    Raises:
        RecordingError: not such a file, an unknown camera, frames of the wrong size, or a torn one; also
            where reading inferred parts was not accepted.
    """
    if not options.accept_inferred:
        raise RecordingError(
            f"{path}: what the frames of a .srs stream hold is inferred, not documented (raw distance, "
            "then raw amplitude); accept that with --inferred, and compare one distance with a tape measure"
        )
    findings.note(".srs frames are raw as far as is known: neither fixed-pattern nor temperature corrected")
    with _open(path) as file:
        model, _ = _camera(path, file)
        expected = _frame_size(model)
        for kind, payload in _objects(file, findings, path):
            if kind != FRAME:
                continue
            if len(payload) != expected:
                raise RecordingError(
                    f"{path}: a frame has {len(payload):,} bytes, expected {expected:,} (distance and "
                    f"amplitude of an {model.name}): other sets of images cannot be read"
                )
            counts, amplitude = np.frombuffer(payload, "<u2").reshape(2, *model.shape)
            yield Exposure(counts.astype(np.uint16), amplitude.astype(np.uint16), None)


def _open(path: Path) -> BinaryIO:
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); name a .srs stream") from error
    header = file.read(8)
    signature, version = header[:4], int.from_bytes(header[4:], "little")
    if signature in SIGNATURES and version == VERSION:
        return file
    file.close()
    said = f"version {version}" if signature in SIGNATURES else f"begins with {header.hex(' ') or 'nothing'}"
    raise RecordingError(f"{path}: is not a .srs stream of version {VERSION} ({said}): name another file")


def _camera(path: Path, file: BinaryIO) -> tuple[_Model, str]:
    kind, payload = next(_objects(file, Findings(), path), (0, b""))
    if kind != INIT or len(payload) != INIT_SIZE - OBJECT_HEADER:
        raise RecordingError(
            f"{path}: does not begin with the camera's description: the file is garbled; copy it again"
        )
    product, _, number = struct.unpack("<III", payload)
    if product not in MODELS:
        known = ", ".join(f"0x{number:04x} ({model.name})" for number, model in MODELS.items())
        raise RecordingError(f"{path}: is of a camera with USB product id 0x{product:04x}; known are {known}")
    return MODELS[product], f"{number:08x}"


def _frame_size(model: _Model) -> int:
    return 2 * 2 * model.shape[0] * model.shape[1]


def _objects(file: BinaryIO, findings: Findings, path: Path) -> Iterator[tuple[int, bytes]]:
    """Ids and payloads; the stream ends where it is torn, and that is noted."""
    while header := file.read(OBJECT_HEADER):
        at = file.tell() - len(header)
        kind, size = struct.unpack("<II", header) if len(header) == OBJECT_HEADER else (0, 0)
        payload = file.read(max(0, size - OBJECT_HEADER))
        if size < OBJECT_HEADER or len(payload) != size - OBJECT_HEADER:
            findings.lost.append(
                f"{path}: torn or garbled at byte {at:,}: all before was read, nothing after"
            )
            return
        yield kind, payload
