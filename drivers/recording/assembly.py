"""Frames put together from messages that come in any order."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, cast

from pydantic import ValidationError

from drivers.documents import told
from drivers.errors import RecordingError
from drivers.messages import CAMERA_AMPLITUDE, CAMERA_DISTANCE, CAMERA_FRAME, FrameFields, decode_image

FRAME_TOPICS = (CAMERA_DISTANCE, CAMERA_AMPLITUDE, CAMERA_FRAME)

MESSAGE_ENCODINGS = {CAMERA_DISTANCE: "protobuf", CAMERA_AMPLITUDE: "protobuf", CAMERA_FRAME: "json"}
"""A message of another encoding on one of these topics is somebody else's."""

_ALL_FIELDS = set(FrameFields.model_fields)
_IMAGES = {CAMERA_DISTANCE: ("<u2", "<f4"), CAMERA_AMPLITUDE: ("<u2",)}
_EXPECTED = {CAMERA_DISTANCE: "16UC1 or 32FC1", CAMERA_AMPLITUDE: "mono16"}


Key = tuple[int, int]
"""Publish time (ns) and sequence (32 bits), which the messages of a frame share."""


class Place(NamedTuple):
    """Where a payload lies: in the chunk at that offset of the file, or in the file itself (None); bytes."""

    chunk: int | None
    start: int
    end: int


class ImageKind(NamedTuple):
    """An image's rows and columns, and whether its values are metres."""

    shape: tuple[int, int]
    is_metric: bool


class Part(NamedTuple):
    """One message of a frame: an image's kind, or the fields."""

    place: Place
    log_time: int
    said: ImageKind | FrameFields


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """What is remembered of each frame: all but its images, their size (rows, columns), and where they lie.

    Attributes:
        log_time: of its fields' message, ns.
        distance, amplitude, said: places of its messages; None = the camera gives no amplitude.
    """

    fields: FrameFields
    shape: tuple[int, int]
    log_time: int
    distance: Place
    amplitude: Place | None
    said: Place

    @property
    def places(self) -> tuple[Place, ...]:
        """Of all its messages."""
        return tuple(place for place in (self.distance, self.amplitude, self.said) if place is not None)

    @property
    def offset(self) -> int:
        """Where its fields lie in the file, bytes; a chunk's begin for all that it holds."""
        place = self.said
        return place.start if place.chunk is None else place.chunk

    @property
    def sequence(self) -> int:
        return self.fields.sequence

    @property
    def timestamp(self) -> int:
        return self.fields.timestamp

    @property
    def burst(self) -> int | None:
        return self.fields.burst

    @property
    def pose(self) -> int | None:
        return self.fields.pose


class FrameAssembler:
    """Matches distance, amplitude and fields by time and sequence; only their places are remembered.

    Where several messages of a topic have one time and sequence (two recordings put into one file), the first
    of each topic belong together, then the second, and so on. A frame whose fields say that the camera gives
    no amplitude waits for none.
    """

    def __init__(self) -> None:
        self._pending: dict[Key, tuple[list[Part], list[Part], list[Part]]] = {}

    def add(self, topic: str, key: Key, part: Part) -> tuple[Part, Part | None, Part] | None:
        """Distance, amplitude and fields of the frame that a part completes, if it does."""
        lists = self._pending.setdefault(key, ([], [], []))
        lists[FRAME_TOPICS.index(topic)].append(part)
        distances, amplitudes, fields = lists
        if not (distances and fields):
            return None
        is_dark = not cast(FrameFields, fields[0].said).has_amplitude
        if not (amplitudes or is_dark):
            return None
        whole = distances.pop(0), None if is_dark else amplitudes.pop(0), fields.pop(0)
        if not any(lists):
            del self._pending[key]
        return whole

    def incomplete(self) -> Iterator[tuple[Key, list[Part]]]:
        """Key and parts of each frame whose other messages never came."""
        for key, lists in self._pending.items():
            for rank in range(max(map(len, lists))):
                yield key, [parts[rank] for parts in lists if rank < len(parts)]


def frame_entry(distance: Part, amplitude: Part | None, fields: Part) -> FrameEntry:
    """A frame of its parts.

    Raises:
        RecordingError: its images are not of one size, or nothing says what its counts stand for.
    """
    said, image = cast(FrameFields, fields.said), cast(ImageKind, distance.said)
    size = image.shape
    if not image.is_metric and said.scale is None and said.ambiguity_range is None:
        raise RecordingError(
            f"counts of frame {said.sequence} have no scale; expected ambiguity_range or scale in "
            f"{CAMERA_FRAME}"
        )
    if amplitude is not None and size != cast(ImageKind, amplitude.said).shape:
        raise RecordingError(
            f"images of frame {said.sequence} do not fit: counts {size} and amplitude "
            f"{cast(ImageKind, amplitude.said).shape}; "
            "expected a pair of equal size"
        )
    place = None if amplitude is None else amplitude.place
    return FrameEntry(said, size, fields.log_time, distance.place, place, fields.place)


def part_of(topic: str, payload: bytes, place: Place, log_time: int) -> Part:
    """A message of a frame, checked.

    Raises:
        RecordingError: it does not decode.
    """
    if topic == CAMERA_FRAME:
        return Part(place, log_time, _fields(payload))
    try:
        image = decode_image(payload)
    except RecordingError as error:
        raise RecordingError(f"{topic}: {error}") from error
    if image.dtype.str not in _IMAGES[topic] or image.ndim != 2:
        raise RecordingError(
            f"{topic}: image of {image.dtype} with shape {image.shape}; expected {_EXPECTED[topic]}"
        )
    return Part(place, log_time, ImageKind((image.shape[0], image.shape[1]), image.dtype.str == "<f4"))


def _fields(payload: bytes) -> FrameFields:
    try:
        checked = FrameFields.model_validate_json(payload)
    except ValidationError as error:
        raise RecordingError(f"{CAMERA_FRAME} is not what it should be: {told(error)}") from error
    # A model's own set of its fields' names is as large as all else in it, and an hour has 180,000 frames.
    return FrameFields.model_construct(_ALL_FIELDS, **dict(checked))
