"""What was received, in words and in files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.json_format import MessageToDict
from numpy.typing import NDArray

from service.errors import ConfigurationError
from service.files import whole_file
from service.jobs.ply import write_ply
from service.messages.decoding import Received, read
from service.messages.report import BurstReport
from service.messages.summary import BurstSummary
from service.messages.summary import describe as describe_burst
from service.messages.topics import FUSED_REPORT


def summarize(received: Received) -> str:
    """One line."""
    value = received.value
    if received.topic == FUSED_REPORT:
        return describe_burst(BurstSummary(report=read(BurstReport, received), errors=None))
    if not isinstance(value, np.ndarray):
        return f"{received.topic} {_compact(plain(received))}"
    if value.dtype.names:
        return f"{received.topic} {len(value)} points ({', '.join(value.dtype.names)})"
    known = value[np.isfinite(value) & (value != 0)] if value.dtype.kind == "u" else value[np.isfinite(value)]
    size = f"{value.shape[1]} × {value.shape[0]} {value.dtype}, {known.size / value.size:.1%} known"
    if not known.size:
        return f"{received.topic} {size}"
    low, middle, high = np.percentile(known, (0, 50, 100))
    return f"{received.topic} {size}, {low:.4g} to {high:.4g}, median {middle:.4g}"


def describe(received: Received) -> str:
    """Images and points in words, everything else as JSON."""
    if not isinstance(received.value, np.ndarray):
        return json.dumps(plain(received), indent=2)
    lines = [summarize(received), f"timestamp {received.timestamp} ns"]
    if received.intrinsics is not None:
        (fx, _, cx), (_, fy, cy), _ = received.intrinsics.tolist()
        lines.append(f"intrinsics fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} pixels")
    return "\n".join(lines)


def as_json(received: Received) -> str:
    """One line of JSON; images and points without their pixels."""
    return _compact(plain(received))


def plain(received: Received) -> Any:
    """What JSON can hold; of images and points only what they are."""
    value = received.value
    if isinstance(value, np.ndarray):
        return {
            "topic": received.topic,
            "timestamp": received.timestamp,
            "shape": list(value.shape),
            "intrinsics": None if received.intrinsics is None else received.intrinsics.tolist(),
        }
    return value if isinstance(value, dict) else MessageToDict(value, preserving_proto_field_name=True)


def save(received: Received, path: Path) -> None:
    """Write to a file by its suffix, whole or not at all.

    Raises:
        ConfigurationError: a suffix that is not known, or not for this kind of message.
        OutputError: it cannot be written.
    """
    write = writer_for(path)
    with whole_file(path) as partial:
        write(received, partial)


def writer_for(path: Path) -> Callable[[Received, Path], None]:
    """How a file of this suffix is written; raises `ConfigurationError` for an unknown one."""
    if path.suffix not in _WRITERS:
        raise ConfigurationError(f"{path}: unknown kind of file; expected one of {', '.join(_WRITERS)}")
    return _WRITERS[path.suffix]


def _array(received: Received, kind: str) -> NDArray[Any]:
    if not isinstance(received.value, np.ndarray):
        raise ConfigurationError(
            f"{received.topic} is neither image nor points: {kind} cannot hold it, use .json"
        )
    return received.value


def _npy(received: Received, path: Path) -> None:
    with path.open("wb") as stream:
        np.save(stream, _array(received, ".npy"))


def _npz(received: Received, path: Path) -> None:
    parts: dict[str, Any] = {
        "value": _array(received, ".npz"),
        "timestamp": np.int64(received.timestamp or 0),
    }
    if received.intrinsics is not None and received.distortion is not None:
        parts |= {"intrinsics": received.intrinsics, "distortion": received.distortion}
    with path.open("wb") as stream:
        np.savez_compressed(stream, **parts)


def _ply(received: Received, path: Path) -> None:
    points = _array(received, ".ply")
    if points.dtype.names is None:
        raise ConfigurationError(f"{received.topic} holds no points: .ply needs fused/points; use .npy")
    write_ply(path, points)


def _json(received: Received, path: Path) -> None:
    path.write_text(json.dumps(plain(received), indent=2) + "\n", encoding="utf-8")


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(", ", ": "))


_WRITERS: dict[str, Callable[[Received, Path], None]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".ply": _ply,
    ".json": _json,
}
