"""The ROS 2 sink beside a service's session, and events for it."""

import json
import logging
import socket
from contextlib import contextmanager

import numpy as np
import zenoh

from drivers import Frame
from drivers.calibration import Calibration, Intrinsics, Mount
from service.config.sections import FusionSection
from service.config.served import Ros2Section
from service.fusion.fuse import fuse_burst
from service.messages.burst import Burst
from service.messages.events import DevicesOpened, FrameCaptured, MapFused, StatusTold
from service.messages.status import Status
from service.sinks.ros import ros_sink
from service.wire.session import open_session

SHAPE = 36, 44
BETA = 4
START = 1_700_000_000_123_456_789
LENS = Calibration(
    width=44,
    height=36,
    intrinsics=Intrinsics(fx=40.0, fy=41.0, cx=21.0, cy=18.0),
    distortion=(-0.3, 0.1, 0.0, 0.0, 0.0),
    mount=Mount(lever_arm=(0.05, -0.02, 0.1)),
)
log = logging.getLogger(__name__)


def made_frame(number=0, *, amplitude=True, shape=SHAPE):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    counts = (15_000 + 100 * rows + 5_000 * (columns > shape[1] // 2)).astype(np.uint16)
    counts[1, 1] = 0
    light = (2_000 + 10 * columns).astype(np.uint16) if amplitude else None
    at = START + number * 20_000_000
    return Frame(counts, light, at, number, 0.1, -0.05, 0.03, 20e6, 7.5, burst=0, pose=number)


def made_map(lens=LENS, upsampling=BETA):
    burst = Burst(0, tuple(made_frame(k, shape=lens.shape) for k in range(2)), lens, 2)
    return fuse_burst(burst, FusionSection(method="nearest", upsampling=upsampling, register_poses=False))


def events(lens=LENS):
    """What a service tells in the course of a burst."""
    return [
        DevicesOpened("SR3000", "device", lens, None, START),
        FrameCaptured(made_frame(), lens.mount),
        MapFused(made_map(lens), None),
        StatusTold(Status(timestamp=START, state="scanning", reason="bursts by the plan")),
    ]


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def ros_rig(tmp_path, namespace=None, **section):
    """(endpoint, sink): a service's session that listens, with a namespace or not, and the sink."""
    endpoint = free_endpoint()
    told = {"listen": {"endpoints": [endpoint]}} | ({} if namespace is None else {"namespace": namespace})
    file = tmp_path / "service.json5"
    file.write_text(json.dumps(told))
    with open_session(file=file):
        sink = ros_sink(Ros2Section(enabled=True, **section), file)()
        sink.open()
        try:
            yield endpoint, sink
        finally:
            sink.close()


def client(endpoint, mode="peer"):
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("listen/endpoints", "[]")
    return zenoh.open(config)
