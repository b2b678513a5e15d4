"""Images as they go to a browser: a JSON header, and numbers that keep what the sensor can tell."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.messages.decoding import Received
from service.messages.topics import TOPICS

CAMERA_DEPTH = "camera/depth"
"""No topic of the rig: `camera/distance` along the optical axis, to be seen beside a map."""

REASON = "fused/reason"

SOURCES = {
    topic: source
    for topic, source in {
        "camera/distance": "camera/distance",
        CAMERA_DEPTH: "camera/distance",
        "camera/amplitude": "camera/amplitude",
        "fused/depth": "fused/depth",
        "fused/deviation": "fused/deviation",
        "fused/amplitude": "fused/amplitude",
        REASON: REASON,
    }.items()
    if source in TOPICS
}
"""What can be shown, by the rig's topic that it is made of."""

_LEVELS = 65534
"""Steps of a quantised image: 16 bits, less one value that means unknown. 0.1 mm at 6 m."""

_SAMPLED = 20_000
"""Pixels, about, from which percentiles are taken."""

_PAYS = 0.85
"""Share of its size under which a compressed image is worth the time to unpack it."""

_ALIGNMENT = 8
_COUNTS = 65536
"""Steps of raw distance counts over the ambiguity range."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """An image that came, and what it needs to be shown.

    Attributes:
        topic: as a browser asks for it.
        received: from the rig.
        sequence: counts up by topic.
        published: when it came here, seconds since the epoch.
        ambiguity_range: metres, of a raw distance.
    """

    topic: str
    received: Received
    sequence: int
    published: float
    ambiguity_range: float | None = None

    def frame(self, *, compressed: bool) -> bytes:
        """One binary frame: header's length, header, data."""
        stored, told = _stored(self)
        data, encoding = _packed(stored) if compressed else (stored.tobytes(), "identity")
        height, width = stored.shape
        header = {
            "topic": self.topic,
            "sequence": self.sequence,
            "time": None if self.received.timestamp is None else self.received.timestamp / 1e9,
            "published": self.published,
            "height": height,
            "width": width,
            "dtype": stored.dtype.name,
            "unit": _unit(self.topic),
            "encoding": encoding,
            "intrinsics": _listed(self.received.intrinsics),
            "distortion": _listed(self.received.distortion),
            **told,
        }
        return _framed(header, data)


def _framed(header: Mapping[str, Any], data: bytes) -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-(4 + len(text)) % _ALIGNMENT)
    return len(text).to_bytes(4, "little") + text + data


def _stored(picture: Picture) -> tuple[NDArray[Any], dict[str, Any]]:
    """The numbers to be sent, and what the header says of them."""
    image = picture.received.value
    if picture.topic == REASON:
        return image.astype(np.uint8, copy=False), {
            "scale": 1,
            "offset": 0,
            "low": 0,
            "high": 5,
            "known": 1.0,
        }
    if image.dtype != np.uint16:
        return _quantised(np.asarray(image, np.float32))
    if picture.topic == "camera/amplitude":
        # A dark pixel has a value: 0 shall not mean unknown, so all move up by one.
        stored = np.minimum(image, _LEVELS) + np.uint16(1)
        return stored, {"scale": 1.0, "offset": -1.0, **_told(stored, 1.0, -1.0)}
    scale = (picture.ambiguity_range or _COUNTS) / _COUNTS
    if picture.topic == CAMERA_DEPTH and picture.received.intrinsics is not None:
        metres = np.where(image == 0, np.float32(np.nan), image * np.float32(scale))
        return _quantised(metres * _cosines(picture.received, image.shape))
    return image, {"scale": scale, "offset": 0.0, **_told(image, scale, 0.0)}


def _quantised(values: NDArray[np.float32]) -> tuple[NDArray[np.uint16], dict[str, Any]]:
    """16 bits over the range of the known values; 0 = unknown."""
    known = np.isfinite(values)
    low, high = (
        float(values.min(where=known, initial=np.inf)),
        float(values.max(where=known, initial=-np.inf)),
    )
    if low > high:
        return np.zeros(values.shape, np.uint16), {
            "scale": 1.0,
            "offset": 0.0,
            "low": 0,
            "high": 0,
            "known": 0,
        }
    scale = (high - low) / _LEVELS or max(abs(high), 1.0) * 1e-6
    offset = low - scale
    levels = (values - np.float32(low)) * np.float32(1 / scale) + np.float32(1.5)
    stored = np.where(known, levels, np.float32(0)).clip(0, _LEVELS + 1).astype(np.uint16)
    return stored, {"scale": scale, "offset": offset, **_told(stored, scale, offset)}


def _told(stored: NDArray[np.uint16], scale: float, offset: float) -> dict[str, Any]:
    """Range of colours and share of known pixels."""
    share = np.count_nonzero(stored) / stored.size
    step = max(1, stored.size // _SAMPLED) | 1  # odd: an even one could meet the same columns in each row
    sampled = stored.ravel()[::step]
    sampled = sampled[sampled > 0]
    if not sampled.size:
        return {"low": 0.0, "high": 0.0, "known": share}
    low, high = np.percentile(sampled, (2, 98)) * scale + offset
    return {"low": float(low), "high": float(high), "known": share}


def _packed(stored: NDArray[Any]) -> tuple[bytes, str]:
    raw = stored.tobytes()
    packed = zlib.compress(raw, 1)
    return (packed, "deflate") if len(packed) < _PAYS * len(raw) else (raw, "identity")


def _cosines(received: Received, shape: tuple[int, int]) -> NDArray[np.float32]:
    assert received.intrinsics is not None
    lens = () if received.distortion is None else tuple(received.distortion)
    return _cosines_of(tuple(received.intrinsics.ravel()), lens, shape)


@lru_cache(maxsize=4)
def _cosines_of(
    matrix: tuple[float, ...], lens: tuple[float, ...], shape: tuple[int, int]
) -> NDArray[np.float32]:
    """(H, W) cosine of the angle between each pixel's ray and the optical axis."""
    import cv2

    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, np.reshape(matrix, (3, 3)), np.array(lens or (0.0,) * 5))
    cosines = 1 / np.sqrt(1 + (rays**2).sum(axis=2))
    return np.asarray(cosines.reshape(shape), np.float32)


def _unit(topic: str) -> str:
    if SOURCES[topic] == "camera/distance":
        return "m"  # of the rig's own topic: counts
    unit = TOPICS[SOURCES[topic]].unit
    return "" if unit == "–" else unit


def _listed(array: NDArray[np.float64] | None) -> list[float] | None:
    return None if array is None else [float(value) for value in array.ravel()]
