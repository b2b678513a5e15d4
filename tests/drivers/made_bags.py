"""Bags as other programs write them: ROS 1, ROS 2 in SQLite and MCAP, Foxglove in MCAP."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

START = 1_700_000_000 * 10**9
PERIOD = 33_333_333
SHAPE = 40, 56
K = (50.0, 0.0, 27.25, 0.0, 52.0, 19.75, 0.0, 0.0, 1.0)
FRAME_ID = "camera_optical_frame"

rosbags = pytest.importorskip("rosbags", reason="needs rosbags")


def depth_image(number=0, shape=SHAPE):
    """(H, W) uint16, millimetres, with the values that mean nothing."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    image = (1500 + 10 * rows + 7 * columns + number).astype(np.uint16)
    image[0, 0], image[1, 1] = 0, 0xFFFF
    return image


def amplitude_image(number=0):
    return (1000 + depth_image(number) // 2).astype(np.uint16)


@dataclass
class Written:
    """A message to be written; `kind` as `sensor_msgs/msg/Image`."""

    topic: str
    kind: str
    message: object
    log_time: int


@dataclass
class Ros:
    """Messages of a distribution."""

    name: str = "ros2_jazzy"
    written: list[Written] = field(default_factory=list)

    def __post_init__(self):
        from drivers.depth.typestore import typestore

        self.store = typestore(self.name)

    @property
    def is_old(self):
        return self.name == "ros1_noetic"

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, stamp, frame_id=FRAME_ID):
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if self.is_old else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id, **more)

    def image(
        self, array, stamp, topic="/camera/depth/image_raw", encoding="16UC1", pad=0, big=False, at=None
    ):
        """Append an image, with padded rows or swapped bytes."""
        height, width = array.shape
        stored = array.astype(array.dtype.newbyteorder(">" if big else "<"))
        rows = np.full((height, width * array.itemsize + pad), 0xAB, np.uint8)
        rows[:, : width * array.itemsize] = stored.view(np.uint8).reshape(height, -1)
        message = self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=int(big),
            step=rows.shape[1],
            data=rows.ravel(),
        )
        self.add(topic, "sensor_msgs/msg/Image", message, stamp if at is None else at)

    def compressed(self, data, told, stamp, topic="/camera/depth/image_raw/compressedDepth"):
        message = self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(stamp),
            format=told,
            data=np.frombuffer(data, np.uint8),
        )
        self.add(topic, "sensor_msgs/msg/CompressedImage", message, stamp)

    def info(self, stamp=START, topic="/camera/depth/camera_info", shape=SHAPE, k=K, d=(0.0,) * 5, **changes):
        p = (k[0] * 0.9, 0.0, k[2], 0.0, 0.0, k[4] * 0.9, k[5], 0.0, 0.0, 0.0, 1.0, 0.0)
        fields = {"d": d, "k": k, "r": np.eye(3).ravel(), "p": p}
        arrays = {(n.upper() if self.is_old else n): np.array(v, float) for n, v in fields.items()}
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        values = {
            "header": self.header(stamp),
            "height": shape[0],
            "width": shape[1],
            "distortion_model": "plumb_bob",
            "binning_x": 0,
            "binning_y": 0,
            "roi": roi,
            **arrays,
            **changes,
        }
        self.add(
            topic, "sensor_msgs/msg/CameraInfo", self.make("sensor_msgs/msg/CameraInfo", **values), stamp
        )

    def transform(self, stamp, parent, child, quaternion, translation=(0.0, 0.0, 0.0), topic="/tf"):
        names = "xyz"
        place = self.make("geometry_msgs/msg/Vector3", **dict(zip(names, translation, strict=True)))
        turn = self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", quaternion, strict=True)))
        link = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=place, rotation=turn),
        )
        message = self.make("tf2_msgs/msg/TFMessage", transforms=[link])
        self.add(topic, "tf2_msgs/msg/TFMessage", message, stamp)

    def add(self, topic, kind, message, log_time):
        self.written.append(Written(topic, kind, message, log_time))

    def save(self, path: Path, storage="mcap", compression=None):
        """Write everything: a ROS 1 bag, or a ROS 2 folder of that storage, packed by `FILE` or `MESSAGE`."""
        return self._save_old(path) if self.is_old else self._save_new(path, storage, compression)

    def _save_new(self, path, storage, compression):
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        writer = Writer(path, version=9, storage_plugin=plugin)
        if compression is not None:
            writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        with writer:
            self._write(writer, self.store.serialize_cdr)
        return path

    def _save_old(self, path):
        from rosbags.rosbag1 import Writer

        with Writer(path) as writer:
            self._write(writer, self.store.serialize_ros1)
        return path

    def _write(self, writer, serialise):
        connections = {}
        for one in self.written:
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, one.kind, typestore=self.store)
            writer.write(connections[one.topic], one.log_time, bytes(serialise(one.message, one.kind)))


def depth_bag(name="ros2_jazzy", count=4, amplitude=False):
    """A bag of one camera at rest."""
    bag = Ros(name)
    bag.info()
    for number in range(count):
        stamp = START + number * PERIOD
        bag.image(depth_image(number), stamp)
        if amplitude:
            bag.image(amplitude_image(number), stamp, "/camera/amplitude/image_raw", "mono16")
    return bag


def write_foxglove(path: Path, messages):
    """MCAP of (topic, protobuf message, log time)."""
    from mcap_protobuf.writer import Writer

    with path.open("wb") as file, Writer(file) as writer:
        for topic, message, log_time in messages:
            writer.write_message(topic, message, log_time=log_time, publish_time=log_time)
    return path
