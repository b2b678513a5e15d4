"""Taking single frames off the bus: trigger, read, check, and never an answer to an earlier request."""

import logging
from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import DeviceLostError, DeviceTimeoutError, OperationError
from drivers.exposure import mid_exposure
from drivers.usb.image import split, unpack
from drivers.usb.order import OrderCheck
from drivers.usb.profile import Profile, usable
from drivers.usb.transport import CALL_TIMEOUT, StallError, Transport

log = logging.getLogger(__name__)

LATENESS = 0.25
"""Seconds that a frame may be late beyond the model's longest exposure: a busy bus, an unknown readout."""

PEEK = 1e-3
"""Seconds, the shortest timeout of libusb: enough to see what lies ready."""

MAX_DRAINED = 16
"""Buffers after which a camera that was asked for nothing counts as one that does not fall silent."""


STREAMED = 2
"""Frames that a camera which sends by itself may hold back: one exposed, one waiting to be read."""


class Exposed(NamedTuple):
    """One frame off the bus; times in ns, images (rows, columns) uint16."""

    counts: NDArray[np.uint16]
    amplitude: NDArray[np.uint16]
    timestamp: int
    uncertainty: int


class FrameReader:
    """Takes frames through buffers that are allocated once.

    Frames carry no number of their own, so each one must be the only answer to the only request under way.
    Bulk transfers keep their order: once the answer to a later request has come, none to an earlier one
    can. After anything that leaves this open, one more frame is asked for, and what comes until the line
    falls silent is thrown away; before every request, nothing may lie ready.

    Attributes:
        number: frames asked for so far; one that never came is a gap.
    """

    def __init__(self, transport: Transport, profile: Profile, clock: Clock, number: int = 0) -> None:
        self._link = transport
        self._profile = profile
        self._clock = clock
        self.number = number
        size = profile.image.read_bytes.known
        self._buffer, self._rest = array("B", bytes(size)), array("B", bytes(size))
        self._pixels = np.frombuffer(self._buffer, dtype=np.uint8)
        self._silence = profile.exposure_bounds(None)[1] + LATENESS
        self._order = OrderCheck(profile.image.planes.known)
        self._is_clean = False  # another program may have left half a frame behind
        self._owed = False  # a frame that was asked for may still come
        self._is_settled = True
        self._read_until = 0

    def settings_changed(self) -> None:
        """Throw the next frame away: its exposure may have begun with the settings before."""
        self._is_settled = False
        self._order = OrderCheck(self._profile.image.planes.known)

    def take(self, deadline: int, integration_time: float | None) -> Exposed:
        """One frame that was asked for by this call.

        Args:
            deadline: clock time in ns after which no more is waited; throwing frames away defers it.
            integration_time: seconds per sample, None = unknown; narrows the time of the exposure.

        Raises:
            DeviceTimeoutError: nothing came.
            DeviceLostError: unplugged.
            OperationError: refused, short or implausible. Before the next frame, what is left of this one
                is thrown away.
        """
        self.number += 1
        try:
            deadline += self._prepare(integration_time)
            return self._expose(deadline, integration_time)
        except StallError as error:
            log.warning("%s; clearing the halt and trying once more", error)
            self._link.clear_halt()
            deadline += self._prepare(integration_time)
            self.number += 1
            return self._expose(deadline, integration_time)

    def _prepare(self, integration_time: float | None) -> int:
        """Make sure that the next request has one answer; returns the ns that it took."""
        started = self._clock.now()
        if self._is_clean and self._is_outdated():
            self._is_clean = False
        if not self._is_clean:
            self._resynchronise()
        if not self._is_settled:
            self._expose(self._clock.now() + round(CALL_TIMEOUT * 1e6), integration_time)
            self._is_settled = True
        return self._clock.now() - started

    def _expose(self, deadline: int, integration_time: float | None) -> Exposed:
        self._is_clean, self._owed = False, True
        requested = self._clock.now()
        self._link.run(self._profile.trigger.known)
        if not self._profile.trigger.known:
            requested = self._read_until  # it sends by itself, and this frame may have waited since
        received = self._read(deadline)
        finished = self._read_until = self._clock.now()
        images = split(self._pixels[:received], self._profile.image)
        counts, amplitude = unpack(images, self._profile.image)
        self._order.check(images)
        self._is_clean, self._owed = True, False
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

    def _is_outdated(self) -> bool:
        """Whether what would be read next was exposed before it is asked for."""
        if not self._profile.trigger.known:
            longest = self._profile.exposure_bounds(None)[1]
            return (self._clock.now() - self._read_until) / 1e9 > longest
        if self._lies_ready():
            log.warning("the camera sent what nobody asked for; it is thrown away")
            return True
        return False

    def _lies_ready(self) -> bool:
        """Whether bytes have come that were not asked for."""
        try:
            # an empty packet may mark the end of a frame, and bytes may follow it
            return any(self._link.read_into(self._rest, PEEK) for _ in range(2))
        except DeviceTimeoutError:
            return False
        except StallError:
            self._link.clear_halt()
            return True
        except DeviceLostError:
            raise
        except OperationError as error:
            log.debug("before a request: %s", error)
            return True

    def _resynchronise(self) -> None:
        """Throw away what is under way, lest it be taken for the answer to the next request."""
        if not self._profile.trigger.known:
            for _ in range(STREAMED):
                self._read(self._clock.now() + round(CALL_TIMEOUT * 1e6))
            self._read_until = self._clock.now()
        else:
            if self._owed:
                self._ask_again()
            self._drain()
        self._is_clean, self._owed = True, False

    def _ask_again(self) -> None:
        try:
            self._link.run(self._profile.trigger.known)
        except StallError:
            self._link.clear_halt()

    def _drain(self) -> None:
        last = ""
        for _ in range(MAX_DRAINED):
            try:
                self._link.read_into(self._rest, self._silence)
            except DeviceTimeoutError:
                return
            except StallError:
                self._link.clear_halt()
            except DeviceLostError:
                raise
            except OperationError as error:
                last = f", lastly: {error}"
        raise OperationError(
            f"the camera does not fall silent after {MAX_DRAINED} reads without a request{last}; plug it in "
            "again, or learn its profile with `lidarboost devices learn`"
        )

    def _remaining(self, deadline: int) -> float:
        return min(max((deadline - self._clock.now()) / 1e9, 0.0), CALL_TIMEOUT / 1e3)
