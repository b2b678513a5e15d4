"""What appearing to ROS 2 costs: processor time, and whether every frame arrives.

    python tests/benchmarks/ros_sink.py [--seconds 10]

Feeds 20 maps of 704 × 576 and 50 frames of 176 × 144 a second to the ROS 2 sink, as a service does that has
encoded them for others already. A process of its own listens to every topic, first without the point cloud,
then with it; then once more with a lens that has distortion, which is taken out of the maps.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "service")]

from foxglove_sink import feed, shown_map  # noqa: E402
from ros_rig import ros_rig  # noqa: E402

from service.messages.events import DevicesOpened, MapFused  # noqa: E402
from service.messages.ros.topics import (  # noqa: E402
    AMPLITUDE_IMAGE,
    DEPTH_IMAGE,
    FUSED_CLOUD,
    FUSED_DEPTH_IMAGE,
    ROS_TOPICS,
)

COUNTED = (DEPTH_IMAGE, AMPLITUDE_IMAGE, FUSED_DEPTH_IMAGE)

LISTENER = """
import sys, time
sys.path.insert(0, {folder!r})
from ros_rig import client
counts = dict.fromkeys({topics!r}, 0)
def heard(name):
    def count(_):
        counts[name] += 1
    return count
with client({endpoint!r}) as session:
    kept = [session.declare_subscriber("0/" + name.strip("/") + "/**", heard(name)) for name in counts]
    print("there", flush=True)
    sys.stdin.read()
    time.sleep(1)
    print(*[counts[name] for name in {counted!r}], flush=True)
"""


def measured(seconds: float, *, cloud: bool, distortion: tuple[float, ...] = ()) -> str:
    names = {topic.full("/lidarboost"): topic.name for topic in ROS_TOPICS.values()}
    topics = [full for full, name in names.items() if cloud or name != FUSED_CLOUD]
    counted = [ROS_TOPICS[name].full("/lidarboost") for name in COUNTED]
    of_map = shown_map()
    lens = of_map.map.calibration.model_copy(update={"distortion": distortion})
    of_map = MapFused(replace(of_map.map, calibration=lens), None)
    with tempfile.TemporaryDirectory() as folder, ros_rig(Path(folder)) as (endpoint, sink):
        code = LISTENER.format(
            folder=str(ROOT / "tests/service"), topics=topics, endpoint=endpoint, counted=counted
        )
        listener = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert listener.stdin is not None
        assert listener.stdout is not None
        assert listener.stdout.readline() == "there\n"
        sink.take(DevicesOpened("SR3000", "device", lens, None, 1))
        feed(sink, of_map, 1.0)
        cost = feed(sink, of_map, seconds)
        sent = [sink._node._sent[name] for name in COUNTED]
        heard, _ = listener.communicate("", timeout=60)
    counts = zip(heard.split(), sent, COUNTED, strict=True)
    return f"{cost:.1%} of a core; arrived: " + ", ".join(f"{a} of {b} {name}" for a, b, name in counts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    print("without the cloud:", measured(seconds, cloud=False))
    print("with the cloud:   ", measured(seconds, cloud=True))
    print("with distortion:  ", measured(seconds, cloud=False, distortion=(-0.3, 0.1, 0.0, 0.0, 0.0)))


if __name__ == "__main__":
    main()
