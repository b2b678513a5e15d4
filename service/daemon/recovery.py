"""What is done while a device is lost."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from drivers.errors import DeviceLostError, OperationError
from service.errors import UnavailableError

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon
    from service.daemon.modes import Mode


class Recovery:
    """Opens lost devices again, and says so; gives up where another mode is asked for first.

    Args:
        daemon: at work.
        mode: that goes on afterwards.
        proven: whether it is over only once a frame has come: a camera that opens may still be silent.
    """

    def __init__(self, daemon: Daemon, mode: Mode, *, proven: bool = True) -> None:
        self._daemon, self._mode, self._proven = daemon, mode, proven

    def __call__(self, error: OperationError) -> bool:
        """Try until it is done; False where something else was asked for first."""
        daemon = self._daemon
        daemon.states.enter("recovering", str(error))
        daemon.control.inbox.refuse(UnavailableError(f"a device is lost ({error}): wait until it is back"))
        done = daemon.rig.reopen(self._elsewhere)
        if done and (daemon.control.paused or not self._proven):
            daemon.states.enter(self._mode.state, self._mode.reason)
        return done

    def _elsewhere(self) -> bool:
        """Whether to give up; meanwhile what can be done without the device is done."""
        with suppress(DeviceLostError):
            self._daemon.control.inbox.serve("pose")
        return self._daemon.control.halted or self._daemon.agenda.next is not None
