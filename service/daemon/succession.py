"""One mode after the other, as they are asked for."""

from __future__ import annotations

import logging
from concurrent.futures import Future
from typing import TYPE_CHECKING

from service.capture.rig import Rig
from service.daemon.modes import Idle, Mode, Scanning, Streaming
from service.errors import InvalidStateError, IoFailureError, MotionError

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_log = logging.getLogger(__name__)


class Succession:
    """What a daemon does until it is told to stop, or one mode ends without another.

    Args:
        daemon: at work; the thread that owns the devices calls.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon

    def work(self, mode: Mode) -> None:
        """One mode after the other, as they are asked for; raises what one that was not asked for raises."""
        entered: Future[None] = Future()
        while not self._daemon.stop.is_set():
            self._daemon.mode = mode
            self._daemon.control.renew()
            self._show(mode.rig)
            if mode.rig.is_open:
                self._daemon.states.enter(mode.state, mode.reason)
            entered.set_result(None)
            following = self._after(mode)
            if following is None:
                return
            mode, entered = following

    def _after(self, mode: Mode) -> tuple[Mode, Future[None]] | None:
        """Work in a mode until it ends; what follows it."""
        try:
            mode.run()
        except MotionError as error:
            if self._daemon.once:
                raise
            self._daemon.agenda.give_up(IoFailureError(str(error)))
            return self._standing_still(error), Future()
        following = self._daemon.agenda.take()
        if following is None and self._daemon.control.halted and not self._daemon.stop.is_set():
            following = Idle(self._daemon), Future()
        if following is None or following[0].state != "scanning" or following[0].rig is not mode.rig:
            self._daemon.agenda.give_up(InvalidStateError("the scan ended before its turn came"))
        if following is not None and isinstance(following[0], (Scanning, Streaming)):
            self._daemon.states.mend("stage")
        return following

    def _standing_still(self, error: MotionError) -> Mode:
        """Nothing moves any more: what made the stage unsafe needs a person, who starts it again."""
        _log.error("%s", error)
        self._daemon.grabber.counts.error = str(error)
        self._daemon.states.degrade("stage", str(error), "look at the stage, then start again")
        return Idle(self._daemon, str(error))

    def _show(self, rig: Rig) -> None:
        """Have frames come from this rig; what the one before has left is fused first."""
        before = self._daemon.origin.rig
        if rig is before:
            return
        while not self._daemon.fusing.backlog.drain(0.1) and not self._daemon.control.halted:
            self._daemon.control.beat()
            self._daemon.control.inbox.serve("pose")
        self._daemon.origin.show(rig, self._daemon.rig.clock.now())
        if before is not None and before is not self._daemon.rig:
            before.close()
            self._daemon.origin.forget(before)
