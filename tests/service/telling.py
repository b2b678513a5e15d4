"""Work of a process that says how far it is."""

import time
from collections.abc import Callable

from service.processes.worker import tell


def telling() -> Callable[[int], str]:
    def answer(request: int) -> str:
        for number in range(request):
            tell(number)
        return "done"

    return answer


def chattering() -> Callable[[float], str]:
    """Says something all the time, and gets nowhere."""

    def answer(request: float) -> str:
        end = time.monotonic() + request
        while time.monotonic() < end:
            tell("still at it")
            time.sleep(0.02)
        return "done"

    return answer
