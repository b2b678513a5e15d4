"""Ending the process where a thread is held up in a library that cannot be interrupted."""

import os
import sys
from threading import Thread

_held_up: list[Thread] = []


def leave_behind(thread: Thread) -> None:
    """This one is waited for no more."""
    _held_up.append(thread)


def leave(status: int) -> None:
    """End the process at once, without the interpreter's own end, where a thread was left behind.

    One that comes back from compiled code while the interpreter ends would abort the process.
    """
    if any(thread.is_alive() for thread in _held_up):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
