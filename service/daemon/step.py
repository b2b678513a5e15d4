"""Some frames of a replay that somebody asked for, and waits for the last map of."""

from collections.abc import Callable

from service.capture.player import Player, Stepped
from service.messages.events import Delivery, Event
from service.messages.map import FusedMap
from service.messages.report import BurstReport


class Step:
    """The step at work, if there is one: it ends with a map, without one, or not at all.

    Args:
        player: knows what comes of it.
        emit: takes the answer, so that it goes out behind what was published before.
    """

    def __init__(self, player: Player, emit: Callable[[Event], None]) -> None:
        self._player, self._emit = player, emit

    def answer(self, stepped: Stepped, result: FusedMap | Exception) -> None:
        """Its last map is there, or cannot be."""
        if not isinstance(result, Exception):
            self._emit(Delivery(lambda: _resolve(stepped, result.report)))
        elif not stepped.done():
            stepped.set_exception(result)

    def end(self) -> None:
        """It ends in the middle of a burst: there is no map."""
        stepped = self._taken()
        if stepped is not None:
            self._emit(Delivery(lambda: _resolve(stepped, None)))

    def fail(self, error: Exception) -> None:
        """It will not be done."""
        stepped = self._taken()
        if stepped is not None and not stepped.done():
            stepped.set_exception(error)

    def _taken(self) -> Stepped | None:
        stepped, self._player.stepped = self._player.stepped, None
        return stepped


def _resolve(stepped: Stepped, report: BurstReport | None) -> None:
    if not stepped.done():
        stepped.set_result(report)
