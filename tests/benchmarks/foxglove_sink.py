"""What the server for Foxglove costs: processor time with one viewer, and memory with one that stalls.

    python tests/benchmarks/foxglove_sink.py [--seconds 10]

Feeds 20 maps of 704 × 576 and 50 frames of 176 × 144 a second to a sink, as a service does that has encoded
them for others already; the viewers are processes of their own.
"""

import argparse
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "service")]

from drivers.calibration import sr3000_calibration  # noqa: E402
from drivers.frame import Frame  # noqa: E402
from service.config.sections import FusionSection  # noqa: E402
from service.config.served import FoxgloveSection  # noqa: E402
from service.fusion.fuse import fuse_burst  # noqa: E402
from service.messages.burst import Burst  # noqa: E402
from service.messages.encoding import event_messages  # noqa: E402
from service.messages.events import Event, FrameCaptured, MapFused  # noqa: E402
from service.sinks.foxglove import Foxglove  # noqa: E402
from service.sinks.sink import Sink  # noqa: E402

MAPS, FRAMES = 20, 50
SHOWN = ("/fused/depth_mm", "/fused/points", "/fused/calibration", "/fused/transform", "/camera/amplitude")
SHOWN += ("/camera/calibration", "/stage/transform", "/fused/report")
"""What the layouts of deploy/viewers show, and more."""

VIEWER = """
import sys, time
sys.path.insert(0, {folder!r})
from foxglove_client import viewer
with viewer({port}) as client:
    while not set({topics!r}) <= client.channels.keys():
        client.read()
    client.subscribe(*{topics!r})
    print("there", flush=True)
    if {stalls}:
        time.sleep(600)
    for _ in client.messages(600):
        pass
"""


def shown_map() -> MapFused:
    random = np.random.default_rng(0)
    frames = []
    for number in range(2):
        counts = (17_000 + random.normal(0, 90, (144, 176))).astype(np.uint16)
        amplitude = np.full((144, 176), 2000, np.uint16)
        frames.append(Frame(counts, amplitude, number * 10**8, number, 0.0, 0.0, 0.03, 20e6, 7.5))
    burst = Burst(0, tuple(frames), sr3000_calibration(), 2)
    return MapFused(fuse_burst(burst, FusionSection(method="nearest", register_poses=False)), None)


def anew(event: Event, number: int) -> Event:
    """The same map or frame at another time, encoded for others already."""
    at = time.time_ns()
    if isinstance(event, MapFused):
        frame = replace(event.map.frame, timestamp=at, sequence=number)
        made: Event = MapFused(replace(event.map, frame=frame), None)
    else:
        assert isinstance(event, FrameCaptured)
        made = FrameCaptured(replace(event.frame, timestamp=at, sequence=number), event.mount)
    event_messages(made)
    return made


def feed(sink: Sink, of_map: MapFused, seconds: float) -> float:
    """Processor seconds per second that the sink costs: of this process, without what is done for others."""
    frame = FrameCaptured(of_map.map.frame, of_map.map.calibration.mount)
    began, others, number = time.monotonic(), 0.0, 0
    before = time.process_time()
    while (now := time.monotonic() - began) < seconds:
        due = [frame, of_map] if number * MAPS // FRAMES > (number - 1) * MAPS // FRAMES else [frame]
        for event in due:
            start = time.thread_time()
            made = anew(event, number)
            others += time.thread_time() - start
            sink.take(made)
        number += 1
        time.sleep(max(0.0, number / FRAMES - now))
    return (time.process_time() - before - others) / (time.monotonic() - began)


def resident() -> float:
    """MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    of_map = shown_map()
    idle = Foxglove(FoxgloveSection(port=0), lambda _: {})
    idle.open()
    without = feed(idle, of_map, seconds / 2)
    idle.close()
    print(f"no viewer: {without:.1%} of a core")
    for stalls in (False, True):
        sink = Foxglove(FoxgloveSection(port=0), lambda _: {})
        sink.open()
        code = VIEWER.format(folder=str(ROOT / "tests/service"), port=sink.port, topics=SHOWN, stalls=stalls)
        viewer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        assert viewer.stdout is not None
        assert viewer.stdout.readline() == b"there\n"
        before = resident()
        cost = feed(sink, of_map, seconds)
        kind = "one that stalls" if stalls else "one viewer"
        print(f"{kind}: {cost:.1%} of a core, {resident() - before:.0f} MB more than before")
        viewer.kill()
        viewer.wait()
        sink.close()


if __name__ == "__main__":
    main()
