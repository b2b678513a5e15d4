"""The topics of another rig of this program."""

from collections import OrderedDict
from typing import Any, ClassVar

from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from pydantic import ValidationError

from drivers.calibration import Calibration
from drivers.documents import told
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.lens_message import calibration_of
from drivers.messages import (
    CAMERA_AMPLITUDE,
    CAMERA_CALIBRATION,
    CAMERA_DISTANCE,
    CAMERA_FRAME,
    FrameFields,
    decode_calibration,
    decode_image,
)
from drivers.remote.feed import Feed
from drivers.remote.mailbox import OPTICS, Letter
from drivers.remote.stamps import stamp_of

_MOST_PENDING = 16
"""Frames of which some messages have come; what lacks one for longer has lost it on the way."""

_TOPICS = {
    "distance": CAMERA_DISTANCE,
    "amplitude": CAMERA_AMPLITUDE,
    "fields": CAMERA_FRAME,
    OPTICS: CAMERA_CALIBRATION,
}


class RigFeed(Feed):
    """Raw frames as they are published, with angles, bursts and poses.

    Args:
        prefix: of the rig's keys.
        calibration: instead of the one that is published, which has optics only; None = that.
    """

    carries_pose: ClassVar[bool] = True

    def __init__(self, prefix: str, calibration: Calibration | None) -> None:
        self.model = f"rig {prefix}"
        self.keys = {role: f"{prefix}/{topic}" for role, topic in _TOPICS.items()}
        self.calibration, self._is_given = calibration, calibration is not None
        self._pending: OrderedDict[int, dict[str, Any]] = OrderedDict()

    @property
    def missing(self) -> str:
        if self.calibration is None:
            return f"calibration ({self.keys[OPTICS]})"
        return f"frame ({self.keys['distance']}, {self.keys['fields']}): is the rig scanning?"

    def take(self, letter: Letter) -> Frame | None:
        payload = letter.payload.to_bytes()
        if letter.role == OPTICS:
            self._take_optics(payload, letter.key)
            return None
        if letter.role == "fields":
            try:
                fields = FrameFields.model_validate_json(payload)
            except ValidationError as error:
                raise RecordingError(f"{letter.key}: is no frame ({told(error)})") from error
            return self._add(fields.timestamp, "fields", fields)
        try:
            return self._add(stamp_of(payload), letter.role, decode_image(payload))
        except (RecordingError, DecodeError) as error:
            raise RecordingError(f"{letter.key}: {error}") from error

    def _take_optics(self, payload: bytes, key: str) -> None:
        if not self._is_given:
            self.calibration = calibration_of(decode_calibration(payload), key) or self.calibration

    def _add(self, time: int, role: str, part: FrameFields | NDArray[Any]) -> Frame | None:
        parts = self._pending.setdefault(time, {})
        parts[role] = part
        fields = parts.get("fields")
        if "distance" in parts and fields is not None and (not fields.has_amplitude or "amplitude" in parts):
            del self._pending[time]
            try:
                frame = FrameFields.frame(fields, parts["distance"], parts.get("amplitude"))
            except ValueError as error:
                raise RecordingError(f"frame {fields.sequence}: {error}") from error
            return None if self.calibration is None else frame  # without optics it means nothing
        while len(self._pending) > _MOST_PENDING:
            self._pending.popitem(last=False)
        return None
