"""Talking to a running service: its latest values, and its messages as they come."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from threading import Event, Thread
from types import TracebackType
from typing import Any, Self

import numpy as np
import zenoh
import zenoh.ext
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.lens_message import calibration_of
from drivers.messages import CAMERA_CALIBRATION
from service.errors import RemoteError
from service.topics import FUSED_CALIBRATION, TOPICS, Congestion, Topic
from service.wire.addresses import DEFAULT_ENDPOINT, DEFAULT_PREFIX
from service.wire.decoding import Received, decode
from service.wire.session import open_session

_IMAGES = 2
"""Images that wait for a slow reader: the one it takes next, and the newest."""
_MESSAGES = 256
"""Small messages that wait: minutes of status, or a storm in the log."""

_POLL = 0.005
"""Seconds between two looks for a message: a tenth of the time between frames at most."""
_RETRY = 0.05

_log = logging.getLogger(__name__)


class Subscription:
    """Messages of one topic, the oldest that is kept first; iterate, or `receive` with a time limit."""

    def __init__(
        self, topic: str, subscriber: Any, decode_sample: Callable[[zenoh.Sample], Received]
    ) -> None:
        self._topic, self._subscriber, self._decode = topic, subscriber, decode_sample
        self._closed = Event()
        self._thread: Thread | None = None

    def receive(self, timeout: float = 5.0) -> Received:
        """The next message.

        Raises:
            RemoteError: none within `timeout` seconds, the subscription is closed, or it cannot be read.
        """
        sample = self._next(timeout)
        if sample is None:
            why = (
                "the subscription is closed"
                if self._closed.is_set()
                else f"nothing came within {timeout:g} s"
            )
            raise RemoteError(f"{self._topic}: {why}; does the service run, and is it scanning?")
        return self._decode(sample)

    def close(self) -> None:
        """End it; whoever iterates comes to an end too."""
        if not self._closed.is_set():
            self._closed.set()
            if self._thread is not None:
                self._thread.join()
            self._subscriber.undeclare()

    def __iter__(self) -> Iterator[Received]:
        while (sample := self._next(None)) is not None:
            yield self._decode(sample)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def call(self, handler: Callable[[Received], None]) -> None:
        """Have each message handed to `handler`, in a thread of its own."""
        self._thread = Thread(target=self._serve, args=(handler,), name=f"client {self._topic}", daemon=True)
        self._thread.start()

    def _serve(self, handler: Callable[[Received], None]) -> None:
        while (sample := self._next(None)) is not None:
            try:
                handler(self._decode(sample))
            except Exception:  # the next message may do better
                _log.exception("the handler of %s failed", self._topic)

    def _next(self, timeout: float | None) -> zenoh.Sample | None:
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._closed.is_set():
            sample: zenoh.Sample | None = self._subscriber.try_recv()
            if sample is not None:
                return sample
            if deadline is not None and time.monotonic() > deadline:
                return None
            time.sleep(_POLL)
        return None


class Client:
    """A connection to a running service. It need not run yet: it is waited for.

    ```python
    with Client() as rig:
        depth = rig.latest("fused/depth")  # depth.value (H, W) metres, depth.intrinsics (3, 3)
        for report in rig.subscribe("fused/report"):
            print(report.value["deviation"])
    ```

    Args:
        endpoint: where the service, or a router, listens.
        prefix: of the service's keys.

    Raises:
        SessionError: the endpoint is not one.
    """

    def __init__(self, endpoint: str = DEFAULT_ENDPOINT, prefix: str = DEFAULT_PREFIX) -> None:
        self._endpoint, self._prefix = endpoint, prefix
        self._resources = ExitStack()
        self._session = self._resources.enter_context(open_session(listen=(), connect=(endpoint,)))

    def close(self) -> None:
        """Close the connection and all subscriptions."""
        self._resources.close()

    def latest(self, topic: str, timeout: float = 5.0) -> Received:
        """The latest value of a topic; the next one where the service keeps none (raw frames).

        Raises:
            RemoteError: unknown topic, no service, or no value within `timeout` seconds.
        """
        row = _published(topic)
        if not row.latest:
            with self.subscribe(topic) as messages:
                return messages.receive(timeout)
        sample = self._ask(topic, timeout)
        if sample is None:
            raise RemoteError(self._explain(topic, timeout))
        return self._decode(sample)

    def subscribe(self, topic: str, handler: Callable[[Received], None] | None = None) -> Subscription:
        """Messages as they come, the latest one first where the service keeps it.

        Of images a slow reader gets the newest; those in between are lost to it, and to it alone.

        Args:
            topic: a topic's name.
            handler: called with each message from a thread of its own; None = iterate or `receive`.

        Raises:
            RemoteError: unknown topic.
        """
        row = _published(topic)
        is_image = row.congestion is Congestion.DROP
        subscriber = zenoh.ext.declare_advanced_subscriber(
            self._session,
            f"{self._prefix}/{topic}",
            zenoh.handlers.RingChannel(_IMAGES if is_image else _MESSAGES),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        subscription = Subscription(topic, subscriber, self._decode)
        self._resources.callback(subscription.close)
        if handler is not None:
            subscription.call(handler)
        return subscription

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _ask(self, topic: str, timeout: float) -> zenoh.Sample | None:
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            for reply in self._session.get(f"{self._prefix}/{topic}", timeout=left):
                if reply.ok is not None:
                    return reply.ok
            time.sleep(_RETRY)
        return None

    def _decode(self, sample: zenoh.Sample) -> Received:
        topic = str(sample.key_expr).removeprefix(f"{self._prefix}/")
        received = decode(topic, str(sample.encoding), sample.payload.to_bytes())
        if not isinstance(received.value, np.ndarray) or received.value.ndim != 2:
            return received
        # The publisher sends the calibration before the image, so an answer is there at once.
        source = CAMERA_CALIBRATION if topic.startswith("camera/") else FUSED_CALIBRATION
        told = self._ask(source, timeout=1.0)
        if told is None:
            return received
        lens = _lens(decode(source, str(told.encoding), told.payload.to_bytes()))
        if lens is None:
            return received
        return replace(
            received, intrinsics=lens.intrinsics.matrix, distortion=np.array(lens.distortion or (0.0,) * 5)
        )

    def _explain(self, topic: str, timeout: float) -> str:
        if self._session.info.links():
            return (
                f"{topic}: the service at {self._endpoint} had no value within {timeout:g} s; has it fused "
                f"anything yet, and is its prefix {self._prefix!r}?"
            )
        return (
            f"no service answered at {self._endpoint} within {timeout:g} s; start one with `lidarboost run`, "
            f"or name the endpoint it listens on"
        )


def _lens(received: Received) -> Calibration | None:
    """What a calibration message tells; None where the camera is not calibrated."""
    if not isinstance(received.value, CameraCalibration):
        raise RemoteError(f"{received.topic}: expected a foxglove.CameraCalibration")
    try:
        return calibration_of(received.value, received.topic)
    except RecordingError as error:
        raise RemoteError(str(error)) from error


def _published(topic: str) -> Topic:
    row = TOPICS.get(topic)
    if row is None or row.congestion is Congestion.NONE:
        known = ", ".join(name for name, row in TOPICS.items() if row.congestion is not Congestion.NONE)
        raise RemoteError(f"no topic is called {topic!r}; there are: {known}")
    return row
