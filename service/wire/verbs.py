"""The commands of a service as methods; each returns the reply's fields and raises a `CommandError`."""

from collections.abc import Callable
from typing import Any

from service.wire.asking import Answer

Ask = Callable[..., Answer]
"""`Client.command`."""


class Scan:
    """Bursts by the plan."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def start(self, timeout: float = 60.0) -> Answer:
        """Scan burst after burst."""
        return self._ask("cmd/scan", "start", timeout)

    def stop(self, timeout: float = 10.0) -> Answer:
        """End after the burst at work; returns at once."""
        return self._ask("cmd/scan", "stop", timeout)

    def cancel(self, timeout: float = 10.0) -> Answer:
        """End at once; the burst at work is discarded."""
        return self._ask("cmd/scan", "cancel", timeout)

    def once(self, timeout: float = 300.0, *, map: bool = False) -> Answer:
        """One burst; returns its `report` once its map is published.

        Args:
            timeout: seconds.
            map: bring the fused messages along, as `Answer.messages` by topic.
        """
        return self._ask("cmd/scan", "once", timeout, map=map)

    def pause(self, timeout: float = 10.0) -> Answer:
        """Stand still after the pose at work."""
        return self._ask("cmd/scan", "pause", timeout)

    def resume(self, timeout: float = 10.0) -> Answer:
        """Go on with the burst that was paused."""
        return self._ask("cmd/scan", "resume", timeout)

    def check(self, timeout: float = 60.0) -> Answer:
        """What a burst would give, as `check`."""
        return self._ask("cmd/scan", "check", timeout)


class Stream:
    """A map for every frame, of the last ones."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def start(self, window: int | None = None, timeout: float = 60.0) -> Answer:
        """Stream; `window` frames are fused together (None = as configured)."""
        return self._ask("cmd/stream", "start", timeout, **({} if window is None else {"window": window}))

    def stop(self, timeout: float = 10.0) -> Answer:
        """End after the frame at work."""
        return self._ask("cmd/stream", "stop", timeout)


class Stage:
    """What turns the camera."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def get(self, timeout: float = 30.0) -> Answer:
        """Where it is, and its limits, radians."""
        return self._ask("cmd/stage", "get", timeout)

    def stop(self, timeout: float = 30.0) -> Answer:
        """Halt at once, whatever it does."""
        return self._ask("cmd/stage", "stop", timeout)

    def home(self, timeout: float = 180.0) -> Answer:
        """Find its reference position. Calling this is consent: nobody may be in the way."""
        return self._ask("cmd/stage", "home", timeout)


class Section:
    """Something with fields that can be read and set.

    Args:
        ask: `Client.command`.
        name: of the command.
    """

    def __init__(self, ask: Ask, name: str) -> None:
        self._ask, self._name = ask, name

    def get(self, timeout: float = 10.0) -> Answer:
        """What is in force."""
        return self._ask(self._name, "get", timeout)

    def set(self, timeout: float = 300.0, **fields: Any) -> Answer:
        """Change some fields; returns what is in force, once the burst at work has ended.

        `timeout` is how long to wait; a field of that name is changed by `Client.ask`.
        """
        return self._ask(self._name, "set", timeout, **fields)
