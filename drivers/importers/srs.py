"""Streams of the vendor's Windows software (`.srs`).

The container is documented by the vendor. That a frame's payload is the sensor's raw output is inferred from
the size of the data on the wire; no such file was at hand. Its images: distance, then amplitude of an SR3000
and SR4000; of an SR2 distance, intensity, and amplitude only where its output selector asks for all three.
"""

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.calibration import Calibration, sr3000_calibration, sr4000_calibration
from drivers.errors import RecordingError
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source
from drivers.importers.srs_calibration import geometry, stored_calibration
from drivers.importers.srs_stream import (
    CALIBRATION,
    CONFIGURE,
    FRAME,
    HEADER,
    INIT,
    Object,
    objects,
    opened,
)

OUTPUT_SELECTOR, ALL_IMAGES = 2, 0xC0
"""SR2: the register, and its value for distance, intensity and amplitude (RobWork)."""

INTEGRATION_TIME, STEP = 9, 0.2e-3
"""SR2: the register (RobWork); SR2B: (v + 1) · 0.2 ms (vendor header)."""

TEST_PATTERN = 4
"""SR3000, SR4000: 1 = a test pattern instead of distance (vendor self-test)."""


@dataclass(frozen=True, slots=True)
class _Model:
    name: str
    shape: tuple[int, int]
    images: tuple[str, ...]
    modulation_frequency: float
    calibration: Callable[[], Calibration]


def _sr2b_calibration() -> Calibration:
    """The vendor's camera data of the SR2B: 8 mm, pixels of 54.8 × 39.2 µm, centre at 62, 80."""
    return geometry(8e-3, (54.8e-6, 39.2e-6), (62.0, 80.0), (160, 124), "the vendor's SR2B data")


MODELS = {
    0x0071: _Model("SR2", (160, 124), ("distance", "intensity", "amplitude"), 20e6, _sr2b_calibration),
    0x0074: _Model("SR3000", (144, 176), ("distance", "amplitude"), 20e6, sr3000_calibration),
    0x0075: _Model("SR4000", (144, 176), ("distance", "amplitude"), 30e6, sr4000_calibration),
}
"""By USB product id, with which the first object names the camera."""


@dataclass(slots=True)
class _State:
    """What the objects so far say: the camera, its registers, its calibration."""

    path: Path
    model: _Model | None = None
    serial: int = 0
    registers: bytes | None = None
    calibration: bytes | None = None
    changed: set[int] = field(default_factory=set)

    def take(self, part: Object) -> None:
        """Note an object that is no frame."""
        if part.kind == INIT:
            self._camera(*struct.unpack("<III", part.payload))
        elif part.kind == CONFIGURE:
            if self.registers is not None:
                pairs = zip(self.registers, part.payload, strict=True)
                self.changed |= {number for number, (old, new) in enumerate(pairs) if old != new}
            self.registers = part.payload
        elif part.kind == CALIBRATION:
            self.calibration = part.payload

    def _camera(self, product: int, _: int, serial: int) -> None:
        if product not in MODELS:
            known = ", ".join(f"0x{number:04x} ({model.name})" for number, model in MODELS.items())
            raise RecordingError(
                f"{self.path}: is of a camera with USB product id 0x{product:04x}; known are {known}"
            )
        if self.model is not None and (self.model, self.serial) != (MODELS[product], serial):
            raise RecordingError(
                f"{self.path}: goes on with another camera ({MODELS[product].name} {serial:08x} after "
                f"{self.model.name} {self.serial:08x}): split it, and import each by itself"
            )
        self.model, self.serial = MODELS[product], serial

    def known(self) -> tuple[_Model, bytes]:
        """The camera and its registers, which stand before any frame."""
        if self.model is None or self.registers is None:
            lacking = "the camera's description" if self.model is None else "the camera's registers"
            raise RecordingError(
                f"{self.path}: does not begin with {lacking}: the file is garbled; copy it again"
            )
        return self.model, self.registers


class SrsFormat:
    """Streams of any number of frames."""

    def source(self, paths: Sequence[Path], options: ImportOptions, findings: Findings) -> Source:
        """The camera that the streams name; raises `RecordingError` as `read`."""
        if not options.accept_inferred:
            raise RecordingError(
                f"{paths[0]}: what the frames of a .srs stream hold is inferred, not documented (raw "
                "distance and amplitude); accept that with --inferred, and compare one distance with a tape "
                "measure"
            )
        states = [_beginning(path) for path in paths]
        model, _ = states[0].known()
        for state in states[1:]:
            other, _ = state.known()
            if (other, state.serial) != (model, states[0].serial):
                raise RecordingError(
                    f"{state.path}: is of an {other.name} {state.serial:08x}, {paths[0]} of an {model.name} "
                    f"{states[0].serial:08x}: import each camera's streams by themselves"
                )
        calibration = None
        if options.calibration is None:
            stored = stored_calibration(states[0].calibration, model.shape, paths[0], findings)
            calibration = stored or model.calibration()
            findings.note(f"optics: {calibration.source}")
        return Source(
            model.name, f"{states[0].serial:08x}", calibration, model.modulation_frequency, "linear"
        )

    def count(self, path: Path) -> int:
        """Frames in a stream, about: its size tells."""
        model, _ = _beginning(path).known()
        return path.stat().st_size // (_size(model) + HEADER)

    def read(
        self, paths: Sequence[Path], source: Source, options: ImportOptions, findings: Findings
    ) -> Iterator[tuple[Path, Exposure]]:
        """The exposures of the streams, without times: the format has none.

        Raises:
            RecordingError: not such a file, an unknown camera, or frames of other images than are known.
        """
        del source, options
        findings.note(
            ".srs frames are raw as far as is known: neither fixed-pattern nor temperature corrected"
        )
        for path in paths:
            with opened(path) as file:
                state = _State(path)
                frames = 0
                for part in objects(path, file, findings):
                    if part.kind == FRAME:
                        yield path, _exposure(state, part, findings)
                        frames += 1
                    else:
                        state.take(part)
                        _changes(state, frames, findings)


FORMAT = SrsFormat()


def _beginning(path: Path) -> _State:
    """What stands before the first frame."""
    state = _State(path)
    with opened(path) as file:
        for part in objects(path, file, Findings()):
            if part.kind == FRAME:
                break
            state.take(part)
    state.known()
    return state


def _exposure(state: _State, part: Object, findings: Findings) -> Exposure:
    model, registers = state.known()
    time = None
    if model.name == "SR2":
        _check_selector(registers, state.path)
        time = (registers[INTEGRATION_TIME] + 1) * STEP
        findings.note(
            "taken for an SR2B, with which an SR2A shares its id: integration time from register 9, in steps "
            "of 0.2 ms"
        )
    elif registers[TEST_PATTERN] == 1:
        raise RecordingError(
            f"{state.path}: holds a test pattern, not distances (register {TEST_PATTERN} is 1)"
        )
    if part.size != _size(model):
        raise RecordingError(
            f"{state.path}: a frame has {part.size:,} bytes, expected {_size(model):,} "
            f"({', '.join(model.images)} of an {model.name}): other sets of images cannot be read"
        )
    images = np.frombuffer(part.payload, "<u2").reshape(len(model.images), *model.shape).astype(np.uint16)
    return Exposure(images[0], images[model.images.index("amplitude")], None, time)


def _check_selector(registers: bytes, path: Path) -> None:
    if registers[OUTPUT_SELECTOR] != ALL_IMAGES:
        raise RecordingError(
            f"{path}: its frames hold distance and intensity, not amplitude (output selector, register "
            f"{OUTPUT_SELECTOR}, is 0x{registers[OUTPUT_SELECTOR]:02x}): record with 0x{ALL_IMAGES:02x}, "
            "which adds the amplitude"
        )


def _changes(state: _State, frames: int, findings: Findings) -> None:
    """Say which registers change in mid-stream without its being known what that means."""
    known = {OUTPUT_SELECTOR, INTEGRATION_TIME} if state.model is MODELS[0x0071] else {TEST_PATTERN}
    unknown = sorted(state.changed - known)
    if frames and unknown:
        findings.note(
            f"{state.path.name}: registers {', '.join(map(str, unknown))} change at frame {frames}; what "
            "they mean is not public: images and their scale are taken to stay the same"
        )
    state.changed.clear()


def _size(model: _Model) -> int:
    return 2 * len(model.images) * model.shape[0] * model.shape[1]
