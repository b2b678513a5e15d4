"""What is configured changes while the service runs: whatever is at work begins anew with it."""

from pydantic import BaseModel

from service.daemon.daemon import Daemon
from service.daemon.modes import Idle, Mode, Scanning


def reconfigure(daemon: Daemon, **sections: BaseModel) -> None:
    """Put other sections of the configuration in force; for the thread that owns the devices.

    Raises:
        PlanError: a plan out of reach; nothing has changed.
    """
    before = daemon.configuration
    daemon.configuration = before.model_copy(update=sections)
    try:
        _renew(daemon)
    except BaseException:
        daemon.configuration = before
        raise


def _renew(daemon: Daemon) -> None:
    """Have the mode at work, or the next, begin anew with what is configured now; raises as `begin`."""
    following = daemon.agenda.next
    mode = following if following is not None else daemon.mode
    if mode is None or mode.rig is not daemon.rig or isinstance(mode, Idle):
        _check_plan(daemon)
    if following is not None and not isinstance(following, Idle):
        daemon.agenda.replace(_anew(following))
    elif following is None and mode is not None and not isinstance(mode, Idle):
        daemon.agenda.ask(_anew(mode))
    daemon.origin.tell_head()


def _check_plan(daemon: Daemon) -> None:
    """A plan is looked at also where nothing is scanned; raises `PlanError`."""
    if daemon.rig.is_open:
        Scanning(daemon).prepare()


def _anew(mode: Mode) -> Mode:
    fresh = mode.anew()
    fresh.prepare()
    return fresh
