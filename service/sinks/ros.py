"""The sink that appears to ROS 2 nodes under rmw_zenoh as one of them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from drivers.calibration import Calibration
from service.config.served import Ros2Section
from service.errors import ConfigurationError
from service.messages.encoding import fused_calibration
from service.messages.events import (
    BurstCaptured,
    DevicesOpened,
    Event,
    FrameCaptured,
    MapFused,
    StatusTold,
)
from service.messages.ros.cloud import point_cloud
from service.messages.ros.diagnostics import diagnostics
from service.messages.ros.images import CameraInfos, image
from service.messages.ros.optics import Optics
from service.messages.ros.topics import (
    AMPLITUDE_IMAGE,
    AMPLITUDE_INFO,
    DEPTH_IMAGE,
    DEPTH_INFO,
    FUSED_AMPLITUDE_IMAGE,
    FUSED_AMPLITUDE_INFO,
    FUSED_CLOUD,
    FUSED_DEPTH_IMAGE,
    FUSED_DEPTH_INFO,
    FUSED_DEVIATION_IMAGE,
    FUSED_DEVIATION_INFO,
)
from service.messages.ros.transforms import (
    FUSED,
    OPTICAL,
    camera_transform,
    fused_transform,
    optical_transform,
)
from service.messages.ros.types import RosMessage, RosTypes
from service.sinks.sink import Room, Sink
from service.wire.ros.node import RosNode
from service.wire.ros.session import open_ros_session

NODE = "lidarboost"


class RosSink(Sink):
    """Publishes frames, maps, optics, transforms and diagnostics as CDR.

    Args:
        section: `[ros2]` of the configuration.
        service_file: the Zenoh file of the service's own session, or None.
    """

    wants = (DevicesOpened, BurstCaptured, FrameCaptured, MapFused, StatusTold)
    room = Room(2000, 64 << 20)
    droppable = (FrameCaptured, MapFused)

    def __init__(self, section: Ros2Section, service_file: Path | None) -> None:
        super().__init__()
        self._section, self._service_file = section, service_file
        self._types = RosTypes(section.distribution)
        self._resources = ExitStack()
        self._info = CameraInfos(self._types)
        self._of_frames: Optics | None = None
        self._of_maps: Optics | None = None

    def open(self) -> None:
        section = self._section
        session = self._resources.enter_context(open_ros_session(section.config, self._service_file))
        self._node = RosNode(
            session, self._types, domain=section.domain, namespace=section.namespace, name=NODE
        )
        self._resources.callback(self._node.close)

    def take(self, event: Event) -> None:
        if not self.abandoned.is_set():
            self._node.publish(self._messages(event))

    def close(self) -> None:
        self._resources.close()

    def _messages(self, event: Event) -> Iterator[RosMessage]:
        match event:
            case DevicesOpened():
                self._learn(event.calibration)
                yield optical_transform(self._types, event.timestamp)
            case BurstCaptured():
                self._learn(event.burst.calibration)
            case FrameCaptured():
                yield from self._of_frame(event)
            case MapFused():
                yield from self._of_map(event)
            case StatusTold():
                yield diagnostics(self._types, event.status, NODE)

    def _learn(self, calibration: Calibration) -> None:
        if self._of_frames is None or self._of_frames.calibration != calibration:
            self._of_frames = Optics(calibration)

    def _of_frame(self, event: FrameCaptured) -> Iterator[RosMessage]:
        frame, optics = event.frame, self._of_frames
        yield camera_transform(self._types, frame.pan, frame.tilt, event.mount, frame.timestamp)
        if optics is None or optics.calibration.shape != frame.shape:
            return  # of another camera of a merged recording; the end of its burst tells
        at = frame.timestamp, OPTICAL
        if self._node.is_heard(DEPTH_IMAGE):
            distance = optics.calibration.correct(frame.distance, frame.ambiguity_range)
            yield image(self._types, DEPTH_IMAGE, distance * optics.depth_of_distance, *at)
        yield self._info(DEPTH_INFO, optics.calibration, *at)
        if frame.amplitude is None:
            return
        if self._node.is_heard(AMPLITUDE_IMAGE):
            yield image(self._types, AMPLITUDE_IMAGE, frame.amplitude, *at)
        yield self._info(AMPLITUDE_INFO, optics.calibration, *at)

    def _of_map(self, event: MapFused) -> Iterator[RosMessage]:
        result, types = event.map, self._types
        frame, calibration = result.frame, fused_calibration(result)
        if self._of_maps is None or self._of_maps.calibration != calibration:
            self._of_maps = Optics(calibration)
        optics = self._of_maps
        at = frame.timestamp, FUSED
        yield fused_transform(types, frame.pan, frame.tilt, result.calibration.mount, frame.timestamp)
        yield self._info(FUSED_DEPTH_INFO, optics.straight, *at)
        yield image(types, FUSED_DEPTH_IMAGE, optics.rectify(result.depth), *at)
        yield self._info(FUSED_DEVIATION_INFO, optics.straight, *at)
        deviation = result.deviation * optics.depth_of_distance
        yield image(types, FUSED_DEVIATION_IMAGE, optics.rectify(deviation), *at)
        if result.amplitude is not None:
            yield self._info(FUSED_AMPLITUDE_INFO, optics.straight, *at)
            yield image(types, FUSED_AMPLITUDE_IMAGE, optics.rectify(result.amplitude), *at)
        if self._node.is_heard(FUSED_CLOUD):
            yield point_cloud(types, result)


def ros_sink(section: Ros2Section, service_file: Path | None) -> Callable[[], RosSink]:
    """What makes the sink; raises `ConfigurationError` where a library is missing."""
    RosTypes(section.distribution)
    try:
        import xxhash  # noqa: F401
    except ImportError as error:
        raise ConfigurationError(
            "[ros2] needs the library xxhash, which is not installed: pip install 'lidarboost[ros2]'"
        ) from error
    return lambda: RosSink(section, service_file)
