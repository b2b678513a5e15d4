"""Frames put together from the messages of a recording."""

from collections import OrderedDict
from typing import Any

from numpy.typing import NDArray
from pydantic import ValidationError

from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.messages import (
    CAMERA_AMPLITUDE,
    CAMERA_DISTANCE,
    CAMERA_FRAME,
    FrameFields,
    Message,
    decode_image,
)

FRAME_TOPICS = (CAMERA_DISTANCE, CAMERA_AMPLITUDE, CAMERA_FRAME)

MAX_PENDING = 16
"""Frames waiting for their other messages; a frame's messages are written together, so more is a loss."""


class FrameAssembler:
    """Matches distance, amplitude and fields by time and sequence.

    Attributes:
        incomplete: sequences (32 bits) of frames whose other messages never came.
    """

    def __init__(self) -> None:
        self.incomplete: list[int] = []
        self._pending: OrderedDict[tuple[int, int], dict[str, bytes]] = OrderedDict()

    def add(self, message: Message) -> Frame | None:
        """The frame that this message completes, if it does.

        Raises:
            RecordingError: messages that do not decode, or do not fit each other.
        """
        key = message.publish_time, message.sequence
        parts = self._pending.setdefault(key, {})
        parts[message.topic] = message.payload
        if len(parts) < len(FRAME_TOPICS):
            if len(self._pending) > MAX_PENDING:
                self._give_up_oldest()
            return None
        del self._pending[key]
        return _frame(parts, message.sequence)

    def finish(self) -> None:
        """No more messages will come."""
        while self._pending:
            self._give_up_oldest()

    def _give_up_oldest(self) -> None:
        (_, sequence), _ = self._pending.popitem(last=False)
        self.incomplete.append(sequence)


def _frame(parts: dict[str, bytes], sequence: int) -> Frame:
    try:
        fields = FrameFields.model_validate_json(parts[CAMERA_FRAME])
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors())
        raise RecordingError(
            f"{CAMERA_FRAME} of frame {sequence} is not what it should be: {faults}"
        ) from error
    counts, amplitude = _image(parts, CAMERA_DISTANCE), _image(parts, CAMERA_AMPLITUDE)
    try:
        return fields.frame(counts, amplitude)
    except ValueError as error:
        raise RecordingError(
            f"images of frame {sequence} do not fit: {error}; expected a pair of equal size, 16UC1 and mono16"
        ) from error


def _image(parts: dict[str, bytes], topic: str) -> NDArray[Any]:
    try:
        return decode_image(parts[topic])
    except RecordingError as error:
        raise RecordingError(f"{topic}: {error}") from error
