"""What others may ask of the thread that owns the devices, and what it looks at on its way."""

from collections.abc import Callable
from threading import Event

from service.capture.inbox import Inbox
from service.errors import InvalidStateError, ServiceError

_LOOK = 0.2
"""Seconds after which a waiting owner looks again though nobody woke it."""


class StoppedError(ServiceError):
    """The capture was told to stop in the middle of a burst."""


class Control:
    """Stop, cancel, pause, and errands; set from any thread, heeded by the owner between two poses.

    Attributes:
        stop: ends the run.
        inbox: errands for the owner.
        beat: called while the owner waits on purpose: a sign of life where no frame comes.
        changed: called when it is paused, or goes on.
    """

    def __init__(self, stop: Event | None = None) -> None:
        self.stop = stop if stop is not None else Event()
        self.inbox = Inbox()
        self.beat: Callable[[], None] = lambda: None
        self.changed: Callable[[], None] = lambda: None
        self._cancelled = self._halting = False
        self._paused = False

    @property
    def paused(self) -> bool:
        return self._paused

    @property
    def halted(self) -> bool:
        """Whether the burst at work shall be given up, and whatever moves shall stop."""
        return self._cancelled or self._halting or self.stop.is_set()

    def cancel(self) -> None:
        """Give up the burst at work."""
        self._cancelled, self._paused = True, False
        self.inbox.wake()

    def halt(self) -> None:
        """Stop whatever moves, and let nothing move until `release`."""
        self._halting, self._paused = True, False
        self.inbox.wake()

    def release(self) -> None:
        """What moved has been stopped."""
        self._halting = False

    def pause(self) -> None:
        """Stand still after the pose at work, until `resume`."""
        self._paused = True
        self.changed()

    def resume(self) -> None:
        """Go on."""
        self._paused = False
        self.inbox.wake()
        self.changed()

    def renew(self) -> None:
        """Forget a cancellation and a pause: something else begins."""
        self._cancelled = self._paused = False

    def check(self) -> None:
        """Raise `StoppedError` where the burst at work shall be given up."""
        if self.halted:
            raise StoppedError("the capture was stopped")

    def between_poses(self) -> None:
        """Do the errands that wait for this moment, and stand still while paused.

        Raises:
            StoppedError: stopped or cancelled.
            DeviceLostError: over an errand.
        """
        self.check()
        self.inbox.serve("pose")
        while self._paused and not self.halted:
            self.inbox.refuse(InvalidStateError("paused in a burst: resume or cancel it first"))
            self.beat()
            self.inbox.wait(_LOOK)
            self.inbox.serve("pose")
        self.check()

    def between_bursts(self) -> None:
        """Do all errands that wait; raises `DeviceLostError` where a device was lost over one."""
        self.inbox.serve("burst")

    def rest(self) -> None:
        """Nothing to do: wait a moment for an errand, and do what there is; raises as `between_bursts`."""
        self.beat()
        self.inbox.wait(_LOOK)
        self.between_bursts()
