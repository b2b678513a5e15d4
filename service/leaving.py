"""Ending the process though a library that cannot be interrupted holds it up."""

import logging
import os
import sys
from collections.abc import Callable
from threading import Thread

_held_up: list[Thread] = []
_all_done = False


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


def skip_the_end() -> None:
    """All is done: what libraries do at the end of the interpreter (Zenoh waits for peers) helps nobody."""
    global _all_done
    _all_done = True


def leave(status: int) -> None:
    """End the process without the interpreter's own end, where that is skipped or a thread was left behind.

    One that comes back from compiled code while the interpreter ends would abort the process.
    """
    if _all_done or any(thread.is_alive() for thread in _held_up):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
