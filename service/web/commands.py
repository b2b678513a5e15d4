"""Commands of a page on their way to the rig: a thread each, so many at most."""

from collections.abc import Callable
from typing import Any

from service.errors import CommandError, RemoteError
from service.web.requests import Command
from service.web.threads import in_thread

_MOST, _MOST_OF_ALL = 8, 64
"""Commands under way of one page, and of all together."""

_URGENT = frozenset({"stop", "cancel", "pause"})
"""Verbs that pass where others have to wait: somebody wants something to end."""

_MOST_URGENT = 32

Ask = Callable[..., dict[str, Any]]
"""`Client.ask`."""


class Count:
    """How many commands are under way, of a page or of all; for the event loop's thread."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._ordinary = self._urgent = 0

    def admits(self, urgent: bool) -> bool:
        """Whether there is room for another."""
        return self._urgent < _MOST_URGENT if urgent else self._ordinary < self._most

    def add(self, urgent: bool, change: int) -> None:
        if urgent:
            self._urgent += change
        else:
            self._ordinary += change


class Commands:
    """Has commands carried out.

    Args:
        ask: `Client.ask`.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._all = Count(_MOST_OF_ALL)

    def page(self) -> Count:
        """A count for one page."""
        return Count(_MOST)

    async def answer(self, command: Command, page: Count) -> dict[str, Any]:
        """The answer to a command, or why there is none, once that is known."""
        urgent = command.action in _URGENT
        counters = (page, self._all)
        if not all(counter.admits(urgent) for counter in counters):
            return error_message(command.id, "BUSY", f"{_MOST} commands are under way: wait for one of them")
        for counter in counters:
            counter.add(urgent, 1)
        try:
            value = await in_thread(lambda: self._carried_out(command))
        except CommandError as error:
            return error_message(command.id, error.code, str(error))
        except RemoteError as error:
            return error_message(command.id, "UNREACHABLE", str(error))
        finally:
            for counter in counters:
                counter.add(urgent, -1)
        return {"type": "answer", "id": command.id, "value": value}

    def _carried_out(self, command: Command) -> dict[str, Any]:
        return dict(self._ask(command.name, command.arguments | {"action": command.action}, command.timeout))


def error_message(number: int | None, code: str, message: str) -> dict[str, Any]:
    """Why a request is not answered."""
    return {"type": "error", "id": number, "code": code, "message": message}
