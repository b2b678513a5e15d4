"""Bursts of a running rig, to be judged."""

import time
from collections import OrderedDict
from contextlib import ExitStack
from threading import Condition

from drivers.messages import CAMERA_AMPLITUDE, CAMERA_DISTANCE, CAMERA_FRAME, FrameFields
from service.errors import RemoteError
from service.evaluation.sight import Sight, Take
from service.jobs.quality import Footage, of_one_view
from service.messages.decoding import Received, read
from service.messages.report import BurstReport
from service.messages.topics import FUSED_DEPTH, FUSED_REPORT
from service.wire.client import Client
from solver.geometry.points import distance_from_depth

_FRAME_TOPICS = (CAMERA_DISTANCE, CAMERA_AMPLITUDE, CAMERA_FRAME)
_TOPICS = (*_FRAME_TOPICS, FUSED_DEPTH, FUSED_REPORT)

_MOST_FRAMES, _MOST_MAPS = 300, 4
"""Frames and maps that wait for what belongs to them: a minute of a camera at 5 frames/s, or 15 MB."""


class _Gathering:
    """What came so far, by the time of its frame."""

    def __init__(self) -> None:
        self.changed = Condition()
        self._parts: dict[str, OrderedDict[int, Received]] = {}

    def take(self, received: Received) -> None:
        """Keep a message."""
        if received.timestamp is None:
            return
        most = _MOST_FRAMES if received.topic in _FRAME_TOPICS else _MOST_MAPS
        with self.changed:
            parts = self._parts.setdefault(received.topic, OrderedDict())
            parts[received.timestamp] = received
            while len(parts) > most:
                parts.popitem(last=False)
            self.changed.notify_all()

    def at(self, topic: str, timestamp: int) -> Received:
        """What a topic said of a time that is whole."""
        return self._parts[topic][timestamp]

    def whole(self, taken: set[int]) -> int | None:
        """The time of a map that is there with its report and its frame, and was not taken yet."""
        times = set.intersection(*(set(self._parts.get(topic, ())) for topic in _TOPICS))
        return min(times - taken, default=None)


def gathered(client: Client, bursts: int, timeout: float) -> Footage:
    """The next maps of a rig, with the frame that each is aligned with.

    A frame's distances are as the camera delivers them: the calibration's corrections are not published.

    Args:
        client: of the rig.
        bursts: maps to wait for; of a stream those that share no frame.
        timeout: seconds to wait for each.

    Raises:
        RemoteError: no map came in time.
    """
    gathering = _Gathering()
    taken: set[int] = set()
    seen: set[int] = set()
    takes: list[Take] = []
    method, frames = None, 0
    with ExitStack() as stack:
        for topic in _TOPICS:
            stack.enter_context(client.subscribe(topic, gathering.take))
        deadline = time.monotonic() + timeout
        while len(takes) < bursts:
            with gathering.changed:
                there = gathering.changed.wait_for(
                    lambda: gathering.whole(taken) is not None, deadline - time.monotonic()
                )
                at = gathering.whole(taken)
                if not there or at is None:
                    raise RemoteError(
                        f"{len(takes)} of {bursts} maps came, the next not within {timeout:g} s; have it "
                        "scan (lidarboost scan start), or wait longer (--timeout)"
                    )
                taken.add(at)
                report = read(BurstReport, gathering.at(FUSED_REPORT, at))
                if seen & set(report.sequence):
                    continue  # maps of a stream share frames, and with them their noise
                seen |= set(report.sequence)
                takes.append(_take(gathering, at))
            method, frames = report.method, frames + report.frames
            deadline = time.monotonic() + timeout
    footage = of_one_view(takes, method, frames)
    raw = "frames are as the camera delivers them, without the calibration's corrections"
    return Footage(footage.takes, footage.method, footage.frames, (*footage.notes, raw))


def _take(gathering: _Gathering, at: int) -> Take:
    depth, image, amplitude, fields = (
        gathering.at(topic, at) for topic in (FUSED_DEPTH, CAMERA_DISTANCE, CAMERA_AMPLITUDE, CAMERA_FRAME)
    )
    if depth.intrinsics is None or depth.distortion is None:
        raise RemoteError("the rig is not calibrated: its maps have no intrinsics")
    lens = tuple(depth.distortion.tolist()) if depth.distortion.any() else None
    after = Sight(distance_from_depth(depth.value, depth.intrinsics, lens), depth.intrinsics, lens)
    if image.intrinsics is None:
        return Take((), after)
    frame = read(FrameFields, fields).frame(image.value, amplitude.value)
    before = Sight(frame.distance, image.intrinsics, lens)
    return Take((before,), after, frame.signal, (frame.pan, frame.tilt))
