"""What became of the events of one sink, over all its restarts."""

from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from typing import Literal

from service.messages.events import Event
from service.messages.status import SinkState
from service.sinks.sink import Sink


class Account:
    """Counts, files and losses of a sink's name; what its sink at work tells of itself comes on top.

    Attributes:
        state: in a word; of one that waits to be restarted too.
        taken: events worked off.
        faults: times that something went wrong.
        abandoned: threads that hung and were given up.
        error: the last fault, in words.
        unit: what is counted as lost.
        worth: how much is lost with an event.
        may_skip: whether what gave way to something newer is no loss.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.state: Literal["running", "restarting", "failed", "ended"] = "running"
        self.taken = self.faults = self.abandoned = 0
        self.error: str | None = None
        self.unit = "events"
        self.worth: Callable[[Event], int] = lambda _: 1
        self.may_skip = False
        self._dropped = 0
        self._files: list[str] = []
        self._losses: list[str] = []
        self._lock = Lock()

    def drop(self, event: Event) -> None:
        """An event was lost."""
        worth = self.worth(event)
        with self._lock:
            self._dropped += worth

    def fault(self, error: str, *, state: Literal["running", "restarting"]) -> None:
        """Something went wrong."""
        self.faults += 1
        self.error, self.state = error, state

    def abandon(self, why: str) -> None:
        """A thread was given up, with the event that it had in hand."""
        self.abandoned += 1
        with self._lock:
            self._dropped += 1
        self.fault(why, state="restarting")

    def keep(self, sink: Sink) -> None:
        """A sink is at its end: what it tells of itself is kept."""
        with suppress(Exception):
            self._files += sink.files
            self._losses += sink.losses
            with self._lock:
                self._dropped += sink.lost

    def dropped(self, sink: Sink | None) -> int:
        """How much was lost so far, with `sink` at work."""
        return self._dropped + (0 if sink is None else sink.lost)

    def told(self, sink: Sink | None, waiting: int) -> SinkState:
        """How it is doing; one that is at fault and tries again by itself counts as restarting."""
        fault = sink.fault if sink is not None and self.state == "running" else None
        return SinkState(
            name=self.name,
            state=self.state if fault is None else "restarting",
            waiting=waiting,
            taken=self.taken,
            dropped=self.dropped(sink),
            faults=self.faults,
            abandoned=self.abandoned,
            error=fault or self.error,
        )

    def files(self, sink: Sink | None) -> list[str]:
        """What was written, complete."""
        return self._files + list(sink.files if sink is not None else ())

    def losses(self, sink: Sink | None) -> list[str]:
        """What was lost, in words; complete once the sink is closed."""
        said = self._losses + list(sink.losses if sink is not None else ())
        skipped_only = self.may_skip and not self.faults
        dropped = self.dropped(sink)
        if (dropped and not skipped_only) or self.state == "failed":
            why = f" ({self.error})" if self.error else ""
            said.append(f"{self.name}: {dropped} {self.unit} lost{why}")
        return said
