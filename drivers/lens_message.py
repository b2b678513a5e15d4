"""Camera calibrations in messages of others, as far as the lens can be used here."""

from collections.abc import Iterable
from typing import Protocol

from pydantic import ValidationError

from drivers.calibration import LENS_TERMS, Calibration, Intrinsics
from drivers.documents import told
from drivers.errors import RecordingError
from drivers.messages import CAMERA_CALIBRATION

_TERMS = {"": 14, "plumb_bob": 5, "rational_polynomial": 14}
"""Models whose terms are OpenCV's k1, k2, p1, p2, k3, …, and how many; none named: ROS means `plumb_bob`."""

_STRAIGHT = frozenset({*_TERMS, "none", "pinhole", "brown_conrady", "inverse_brown_conrady"})
"""Models that with all terms zero are a pinhole; of a fisheye's that is not so: its radius is f · θ then."""


class LensMessage(Protocol):
    """What is read of a message; that of ROS has the same."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def distortion_model(self) -> str: ...
    @property
    def K(self) -> Iterable[float]: ...  # noqa: N802
    @property
    def D(self) -> Iterable[float]: ...  # noqa: N802


def calibration_of(message: LensMessage, origin: str) -> Calibration | None:
    """Intrinsics and distortion of a message; None where it says that the camera is not calibrated (K zero).

    Args:
        message: decoded, nothing else about it is known.
        origin: of the message, for errors.

    Source: sensor_msgs/CameraInfo, whose fields these are, for K of zeros and the models' names.

    Raises:
        RecordingError: a lens model that cannot be used here, by its name, or figures that are none.
    """
    K = tuple(message.K)
    if len(K) not in (0, 9):
        raise RecordingError(f"{origin}: K has {len(K)} values; expected 9, row by row")
    if not any(K):
        return None
    fx, skew, cx, zero, fy, cy, *last = K
    if (skew, zero, *last) != (0, 0, 0, 0, 1):
        raise RecordingError(f"{origin}: K is {list(K)}; expected [fx, 0, cx, 0, fy, cy, 0, 0, 1] (no skew)")
    try:
        return Calibration(
            width=message.width,
            height=message.height,
            intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy),
            distortion=_distortion(message, origin),
            source=f"message on {CAMERA_CALIBRATION}",
        )
    except ValidationError as error:
        raise RecordingError(f"{origin}: not a calibration ({told(error)})") from error


def _distortion(message: LensMessage, origin: str) -> tuple[float, ...]:
    terms, model = list(message.D), message.distortion_model
    while terms and terms[-1] == 0:
        terms.pop()
    if model not in (_TERMS if terms else _STRAIGHT):
        raise RecordingError(
            f"{origin}: the lens model {model!r} cannot be used here; known are "
            f"{', '.join(filter(None, _TERMS))}: calibrate the camera with one of them and name the file in "
            "camera.calibration"
        )
    if not terms:
        return ()
    if len(terms) > _TERMS[model]:
        raise RecordingError(
            f"{origin}: {len(terms)} terms of distortion; expected at most {_TERMS[model]} of "
            f"{model or 'a lens without a name'}"
        )
    size = next(size for size in LENS_TERMS if len(terms) <= size)
    return (*terms, *[0.0] * (size - len(terms)))
