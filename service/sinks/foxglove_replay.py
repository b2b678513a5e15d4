"""A viewer's playback control, bound to the replay of the service."""

import logging
from collections.abc import Callable
from typing import Any

from service.errors import RemoteError
from service.messages.replay import ReplayState

Ask = Callable[[dict[str, Any]], dict[str, Any]]
"""Has `cmd/replay` do something; gives the reply. Raises `RemoteError` where it is refused."""

_SLOWEST, _FASTEST = 1e-3, 1e3

_log = logging.getLogger(__name__)


class ReplayControl:
    """Where the replay is, in a viewer's terms: absolute times, gaps of the clock cut short as it plays them.

    Args:
        ask: has `cmd/replay` do something.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._told = ReplayState()
        self._begin = 0

    @property
    def is_loaded(self) -> bool:
        return self._told.file is not None

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last time of what is loaded, ns since the epoch; None = nothing is."""
        return (self._begin, self._begin + round(self._told.duration * 1e9)) if self.is_loaded else None

    @property
    def now(self) -> int | None:
        """Where it is, ns since the epoch; None = nothing is loaded."""
        return self._begin + round(self._told.seconds * 1e9) if self.is_loaded else None

    def follow(self, told: ReplayState) -> bool:
        """Take where it is; whether something else is loaded now."""
        before, self._told = self._told, told
        changed = (before.file, before.frames) != (told.file, told.frames)
        if told.file is not None and (changed or not self._begin) and told.recorded is not None:
            self._begin = told.recorded - round(told.seconds * 1e9)
        return changed

    def state(self, request: str | None = None, *, did_seek: bool = False) -> Any:
        """The library's state of it."""
        from foxglove.websocket import PlaybackState, PlaybackStatus

        told = self._told
        status = PlaybackStatus.Playing if told.playing else PlaybackStatus.Paused
        return PlaybackState(
            PlaybackStatus.Ended if told.ended else status,
            self.now or 0,
            told.speed or 1.0,
            did_seek,
            request,
        )

    def carry_out(self, request: Any) -> Any:
        """Seek, then set the speed, then play or pause, as a viewer asks; gives the state then, or None."""
        if not self.is_loaded:
            return None
        seeks = request.seek_time is not None
        try:
            for wanted in self._verbs(request):
                reply = self._ask(wanted)
                self._told = ReplayState.model_validate(reply["replay"])
        except RemoteError as error:
            _log.warning("a viewer's playback control was refused: %s", error)
            seeks = False
        return self.state(request.request_id, did_seek=seeks)

    def _verbs(self, request: Any) -> list[dict[str, Any]]:
        from foxglove.websocket import PlaybackCommand

        told, verbs = self._told, []
        if request.seek_time is not None:
            seconds = (request.seek_time - self._begin) / 1e9
            verbs.append({"action": "seek", "seconds": min(max(seconds, 0.0), told.duration)})
        speed = request.playback_speed
        if speed is not None and speed > 0 and speed != told.speed:
            verbs.append({"action": "speed", "speed": min(max(speed, _SLOWEST), _FASTEST)})
        plays = request.playback_command == PlaybackCommand.Play
        if plays != told.playing:
            verbs.append({"action": "play" if plays else "pause"})
        return verbs
