"""What a client receives: messages of a topic as they come, and the calibration that images belong to."""

import logging
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from threading import Condition, Thread
from types import TracebackType
from typing import Any, Self

import numpy as np
import zenoh
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.lens_message import calibration_of
from service.errors import RemoteError
from service.messages.decoding import Received, decode

CALIBRATION_WAIT = 1.0
"""Seconds that an image waits for the calibration that belongs to it."""

_log = logging.getLogger(__name__)


class Subscription:
    """Messages of one topic, the oldest that is kept first; iterate, or `receive` with a time limit."""

    def __init__(
        self,
        topic: str,
        keep: int,
        decode_sample: Callable[[zenoh.Sample], Received],
        subscribe: Callable[[Callable[[zenoh.Sample], None]], Any],
        closed: Callable[["Subscription"], None] = lambda _: None,
    ) -> None:
        self._topic, self._decode, self._told_closed = topic, decode_sample, closed
        self._samples: deque[zenoh.Sample] = deque(maxlen=keep)
        self._changed = Condition()
        self._closed = False
        self._thread: Thread | None = None
        self._subscriber = subscribe(self._arrived)

    def receive(self, timeout: float = 5.0) -> Received:
        """The next message.

        Raises:
            RemoteError: none within `timeout` seconds, the subscription is closed, or it cannot be read.
        """
        sample = self._next(timeout)
        if sample is None:
            why = "the subscription is closed" if self._closed else f"nothing came within {timeout:g} s"
            raise RemoteError(f"{self._topic}: {why}; does the service run, and is it scanning?")
        return self._decode(sample)

    def close(self) -> None:
        """End it; whoever iterates comes to an end too."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self._subscriber.undeclare()
        self._told_closed(self)

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

    def _arrived(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self._samples.append(sample)
            self._changed.notify_all()

    def _next(self, timeout: float | None) -> zenoh.Sample | None:
        with self._changed:
            self._changed.wait_for(lambda: self._closed or bool(self._samples), timeout)
            return None if self._closed or not self._samples else self._samples.popleft()


class LatestCalibration:
    """The latest calibration that came; the publisher sends it before the images that it belongs to."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._latest: Calibration | RemoteError | None = None
        self._came = False

    def arrived(self, sample: zenoh.Sample) -> None:
        """Take one that came."""
        topic = str(sample.key_expr)
        told: Calibration | RemoteError | None
        try:
            told = calibration_in(decode(topic, str(sample.encoding), sample.payload.to_bytes()))
        except RemoteError as error:
            told = error
        with self._changed:
            self._latest, self._came = told, True
            self._changed.notify_all()

    def given_to(self, image: Received) -> Received:
        """The image with its intrinsics and distortion; without, where none of its size comes in time.

        Raises:
            RemoteError: the lens is one that cannot be used.
        """

        def fits() -> bool:
            other = isinstance(self._latest, Calibration) and self._latest.shape != image.value.shape
            return self._came and not other

        with self._changed:
            self._changed.wait_for(fits, CALIBRATION_WAIT)
            latest = self._latest
        if isinstance(latest, RemoteError):
            raise latest
        if latest is None or latest.shape != image.value.shape:
            return image
        lens = np.array(latest.distortion or (0.0,) * 5)
        return replace(image, intrinsics=latest.intrinsics.matrix, distortion=lens)


def calibration_in(received: Received) -> Calibration | None:
    """What a calibration message tells; None where the camera is not calibrated.

    Raises:
        RemoteError: it is none, or has a lens that cannot be used.
    """
    if not isinstance(received.value, CameraCalibration):
        raise RemoteError(f"{received.topic}: expected a foxglove.CameraCalibration")
    try:
        return calibration_of(received.value, received.topic)
    except RecordingError as error:
        raise RemoteError(str(error)) from error
