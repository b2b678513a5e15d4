"""Taking single frames off the bus: trigger, read, check; once more after a stall."""

import logging
from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import DeviceLostError, DeviceTimeoutError, OperationError
from drivers.exposure import mid_exposure
from drivers.usb.image import unpack
from drivers.usb.profile import Profile, usable
from drivers.usb.transport import CALL_TIMEOUT, StallError, Transport

log = logging.getLogger(__name__)

DRAIN_TIMEOUT = 0.25
"""Seconds of silence after which nothing of a failed frame is on its way: the longest takes 4 · 51.2 ms."""

MAX_DRAINED = 4
"""Buffers thrown away at most while draining, so that a camera that streams by itself cannot hold it up."""


class Exposed(NamedTuple):
    """One frame off the bus; times in ns, images (rows, columns) uint16."""

    counts: NDArray[np.uint16]
    amplitude: NDArray[np.uint16]
    timestamp: int
    uncertainty: int


class FrameReader:
    """Takes frames through buffers that are allocated once."""

    def __init__(self, transport: Transport, profile: Profile, clock: Clock) -> None:
        self._link = transport
        self._profile = profile
        self._clock = clock
        size = profile.image.read_bytes.known
        self._buffer, self._rest = array("B", bytes(size)), array("B", bytes(size))
        self._pixels = np.frombuffer(self._buffer, dtype=np.uint8)
        self._is_stale = True  # another program may have left half a frame behind

    def take(self, deadline: int, integration_time: float | None) -> Exposed:
        """One frame.

        Args:
            deadline: clock time in ns after which no more is waited.
            integration_time: seconds per sample, None = unknown; narrows the time of the exposure.

        Raises:
            DeviceTimeoutError: nothing came.
            DeviceLostError: unplugged.
            OperationError: refused, short or implausible. Before the next frame, what is left of this one
                is thrown away.
        """
        if self._is_stale:
            self._drain()
        self._is_stale = True
        try:
            frame = self._expose(deadline, integration_time)
        except StallError as error:
            log.warning("%s; clearing the halt and trying once more", error)
            self._link.clear_halt()
            frame = self._expose(deadline, integration_time)
        self._is_stale = False
        return frame

    def _expose(self, deadline: int, integration_time: float | None) -> Exposed:
        requested = self._clock.now()
        self._link.run(self._profile.trigger.known)
        received = self._read(deadline)
        finished = self._clock.now()
        counts, amplitude = unpack(self._pixels[:received], self._profile.image)
        waits = self._profile.trigger_starts_exposure
        timestamp, uncertainty = mid_exposure(
            requested,
            finished,
            *self._profile.exposure_bounds(integration_time),
            self._profile.image.frame_bytes,
            waits=bool(waits.value) and usable(waits, allow_inferred=False),
        )
        return Exposed(counts, amplitude, timestamp, uncertainty)

    def _read(self, deadline: int) -> int:
        """Bytes of one frame in the buffer; a read that comes up short is continued until the deadline."""
        needed = self._profile.image.frame_bytes
        received = self._link.read_into(self._buffer, self._remaining(deadline))
        while received < needed:
            try:
                count = self._link.read_into(self._rest, self._remaining(deadline))
            except DeviceTimeoutError as error:
                raise OperationError(f"short frame: {received} of {needed} bytes") from error
            count = min(count, len(self._buffer) - received)
            self._buffer[received : received + count] = self._rest[:count]
            received += count
        return received

    def _drain(self) -> None:
        """Throw away what a failed frame has left, lest it be taken for the next one."""
        for _ in range(MAX_DRAINED):
            try:
                self._link.read_into(self._rest, DRAIN_TIMEOUT)
            except StallError:
                self._link.clear_halt()
            except DeviceLostError:
                raise
            except OperationError:  # mostly the silence that was waited for
                break

    def _remaining(self, deadline: int) -> float:
        return min(max((deadline - self._clock.now()) / 1e9, 0.0), CALL_TIMEOUT / 1e3)
