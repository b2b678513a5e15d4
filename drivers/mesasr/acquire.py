"""Frames through the vendor's library: asked for, waited for, and never those of an earlier request."""

from collections.abc import Callable
from ctypes import c_void_p

from drivers.clock import Clock
from drivers.errors import DeviceLostError, OperationError
from drivers.mesasr.library import Library

LATENESS = 0.25
"""Seconds that a frame may be late beyond its exposure; no timeout of the library is shorter than both."""

MAX_FAILURES = 5
"""Failed frames in a row after which the camera counts as lost, so that it is opened afresh."""


class Acquirer:
    """Asks one camera for frames; the caller holds the camera's lock.

    Args:
        bounds: seconds that the exposure of the next frame takes at least and at most.
    """

    def __init__(
        self,
        library: Library,
        handle: c_void_p,
        clock: Clock,
        bounds: Callable[[], tuple[float, float]],
    ) -> None:
        self._library, self._handle = library, handle
        self._clock = clock
        self._bounds = bounds
        self._failures = 0
        self._is_clean = True
        self._is_settled = True

    def settings_changed(self) -> None:
        """Throw the next frame away: its exposure may have begun with the settings before."""
        self._is_settled = False

    def prepare(self, deadline: int) -> int:
        """Throw away what a failure or other settings left behind; returns the ns that it took.

        Raises:
            DeviceLostError: the library gives the answers to earlier requests.
            OperationError: a frame failed.
        """
        began = self._clock.now()
        if not self._is_clean:
            self._resynchronise()
        if not self._is_settled:
            self.acquire(deadline)
            self._is_settled = True
        return self._clock.now() - began

    def acquire(self, deadline: int) -> tuple[int, int]:
        """A frame, now in the library's images: when it was asked for, and when it was there, ns.

        Raises:
            DeviceLostError: it failed as others before.
            OperationError: it failed.
        """
        _, longest = self._bounds()
        allowed = max((deadline - self._clock.now()) / 1e9, longest + LATENESS)
        if self._library.has("SR_SetTimeout"):
            self._library.call("SR_SetTimeout", self._handle, round(allowed * 1e3))
        requested = self._clock.now()
        received = self._library.call("SR_Acquire", self._handle)
        if received <= 0:
            self._is_clean = False
            raise self._failure(received)
        self._failures = 0
        return requested, self._clock.now()

    def _resynchronise(self) -> None:
        """Throw a frame away, and see that it was not one that was asked for earlier.

        After a failure the library may be one frame behind from then on, and nothing but time tells: what
        has come in the meantime is there at once.
        """
        shortest, longest = self._bounds()
        self._clock.sleep(longest + LATENESS)
        requested, finished = self.acquire(self._clock.now())
        if finished - requested < shortest * 1e9:
            raise DeviceLostError(
                f"after a failure a frame came {(finished - requested) / 1e6:.0f} ms after it was asked for, "
                f"but takes {shortest * 1e3:.0f} ms: it was an earlier one; the camera must be opened anew"
            )
        self._is_clean = True

    def _failure(self, received: int) -> OperationError:
        self._failures += 1
        text = f"SR_Acquire failed with {received}{self._library.explain()}"
        if self._failures >= MAX_FAILURES:
            return DeviceLostError(f"{text}, {self._failures} times in a row: the camera counts as lost")
        return OperationError(text)
