"""Depth images of other cameras, in messages of ROS 2 or Foxglove."""

import logging
from collections import OrderedDict
from typing import Any, ClassVar, NamedTuple

from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.depth.messages import IMAGE_TYPES, LENS_TYPES, Form, image_of, lens_of
from drivers.depth.reading import DepthReading, Ranging, amplitude_counts, saturation_level
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.remote.feed import Feed
from drivers.remote.mailbox import OPTICS, Letter
from drivers.remote.options import ZenohOptions
from drivers.remote.stamps import Stamps

_MOST_PENDING = 8
"""Images that wait for the other one of their time."""
_NEVER_PAIRED = 100
"""Images in a row without the other one, from which something must be wrong."""

_log = logging.getLogger(__name__)


class _Seen(NamedTuple):
    """An image that came: pixels, stamp (ns), number among those of its key, and when it came (ns)."""

    pixels: NDArray[Any]
    stamp: int
    number: int
    arrived: int


class ImageFeed(Feed):
    """Depth, and amplitude of equal stamp where it is named, with the optics beside them.

    Args:
        options: checked.
        calibration: instead of the published one; None = that.
    """

    carries_pose: ClassVar[bool] = False

    def __init__(self, options: ZenohOptions, calibration: Calibration | None) -> None:
        assert options.depth is not None
        self._is_ros = options.source == "ros2"
        depth = options.depth.strip("/")
        names = {"depth": depth, OPTICS: _beside(depth, options)}
        if options.amplitude is not None:
            names["amplitude"] = options.amplitude.strip("/")
        self.keys = {role: self._key(name, options.domain) for role, name in names.items()}
        self.model = f"depth camera on {options.depth}"
        self._reading = DepthReading(kind=options.kind, scale=options.scale, invalid=options.invalid)
        self._rectified = options.rectified
        if self._rectified is None:
            self._rectified = "rect" in depth.rpartition("/")[2]
        self.calibration, self._is_given = calibration, calibration is not None
        self._ranging = None if calibration is None else Ranging(self._reading, calibration)
        self._stamps = Stamps(options.depth)
        self._pending: OrderedDict[int, dict[str, _Seen]] = OrderedDict()
        self._unpaired = 0

    @property
    def missing(self) -> str:
        if self.calibration is None:
            return f"camera information ({self.keys[OPTICS]}); publish it, or name a calibration file"
        return f"depth image ({self.keys['depth']})"

    def take(self, letter: Letter) -> Frame | None:
        kind, form = self._type(letter)
        payload = letter.payload.to_bytes()
        if letter.role == OPTICS:
            if kind in LENS_TYPES and not self._is_given:
                self._take_optics(kind, form, payload, letter.key)
            return None
        if kind not in IMAGE_TYPES:
            raise RecordingError(f"{letter.key}: holds {kind or letter.encoding!r}; expected an image")
        image = image_of(kind, form, payload)
        pixels = image.depth() if letter.role == "depth" else image.decode()
        seen = _Seen(pixels, image.stamp, letter.number, letter.arrived)
        if "amplitude" not in self.keys:
            return self._frame(seen, None)
        parts = self._paired(image.stamp or letter.arrived, letter.role, seen)
        return None if parts is None else self._frame(parts["depth"], parts["amplitude"].pixels)

    def _take_optics(self, kind: str, form: Form, payload: bytes, key: str) -> None:
        found = lens_of(kind, form, payload)
        known = (found.rectified if self._rectified else found.raw).calibration(key)
        if known != self.calibration:
            self.calibration, self._ranging = known, Ranging(self._reading, known)

    def _paired(self, time: int, role: str, seen: _Seen) -> dict[str, _Seen] | None:
        """Both images of a time, once they are there."""
        parts = self._pending.setdefault(time, {})
        parts[role] = seen
        if len(parts) == 2:
            self._unpaired = 0
            return self._pending.pop(time)
        while len(self._pending) > _MOST_PENDING:
            self._pending.popitem(last=False)
            self._unpaired += 1
            if self._unpaired == _NEVER_PAIRED:
                _log.warning(
                    "%s and %s have no stamps in common: no frame can be made of them",
                    self.keys["depth"],
                    self.keys["amplitude"],
                )
        return None

    def _frame(self, depth: _Seen, amplitude: NDArray[Any] | None) -> Frame | None:
        if self._ranging is None:  # nothing is known of the optics so far
            return None
        counts, scale = self._ranging.counts(depth.pixels)
        light = None if amplitude is None else amplitude_counts(amplitude)
        if light is not None and light.shape != counts.shape:
            raise RecordingError(f"depth {counts.shape} and amplitude {light.shape} have different sizes")
        time, uncertainty = self._stamps.time(depth.stamp, depth.arrived)
        return Frame(
            counts=counts,
            amplitude=light,
            timestamp=time,
            sequence=depth.number,
            pan=0.0,
            tilt=0.0,
            integration_time=None,
            modulation_frequency=None,
            ambiguity_range=None,
            timestamp_uncertainty=uncertainty,
            saturation_level=saturation_level(amplitude),
            scale=scale,
        )

    def _key(self, name: str, domain: int) -> str:
        return f"{domain}/{name}/*/*" if self._is_ros else name

    def _type(self, letter: Letter) -> tuple[str, Form]:
        """Told by the key's last but one part, `sensor_msgs::msg::dds_::Image_`, or by the encoding."""
        if self._is_ros:
            package, _, name = letter.key.split("/")[-2].partition("::msg::dds_::")
            return f"{package}/msg/{name.removesuffix('_')}", "cdr"
        schema = letter.encoding.partition(";")[2]
        return schema or ("foxglove.CameraCalibration" if letter.role == OPTICS else "foxglove.RawImage"), (
            "protobuf"
        )


def _beside(depth: str, options: ZenohOptions) -> str:
    if options.camera_info is not None:
        return options.camera_info.strip("/")
    parent, _, last = depth.rpartition("/")
    if options.source == "ros2" and last in ("compressed", "compressedDepth"):
        parent = parent.rpartition("/")[0]
    name = "camera_info" if options.source == "ros2" else "calibration"
    return f"{parent}/{name}" if parent else name
