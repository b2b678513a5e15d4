"""Ending the process where a thread is held up in a library that cannot be interrupted."""

import os
import sys
from collections.abc import Callable
from threading import Thread

_held_up: list[Thread] = []


def leave_behind(thread: Thread) -> None:
    """This one is waited for no more."""
    _held_up[:] = [*filter(Thread.is_alive, _held_up), thread]


def within(seconds: float, work: Callable[[], object], name: str) -> bool:
    """Do something that a library may hold up; False where it takes longer: it is left behind then."""
    thread = Thread(target=work, name=name, daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        leave_behind(thread)
        return False
    return True


def leave(status: int) -> None:
    """End the process at once, without the interpreter's own end, where a thread was left behind.

    One that comes back from compiled code while the interpreter ends would abort the process.
    """
    if any(thread.is_alive() for thread in _held_up):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
