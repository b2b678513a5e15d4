"""What every sink is: it takes events, in a thread that is its own."""

from dataclasses import dataclass
from threading import Event as Flag
from typing import ClassVar

from pydantic import BaseModel, ConfigDict

from service.messages.events import Event


class NoOptions(BaseModel):
    """Of a sink that has none."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass(frozen=True, slots=True)
class Room:
    """How much may wait for a sink: events, and bytes that they hold."""

    events: int
    size: int


class Sink:
    """Takes events one by one; everything is called in one thread, which nobody else waits for.

    What it raises is counted and shown, and a new one is made in its place after a while. Where it hangs it
    is given up: `abandoned` is set, and whatever it does from then on must have no effect.

    Attributes:
        wants: kinds of events that it is given.
        room: what may wait for it; when that is full, live, `droppable` kinds go first, oldest first.
        droppable: kinds that are worth least.
        newest_suffice: live, what gives way to something newer is counted, but no loss.
        slowest: seconds that one event may take before the sink counts as hanging, where that is more than
            usual: one that waits for something with a limit of its own must get that limit and some more.
    """

    wants: ClassVar[tuple[type[Event], ...]] = (Event,)
    room: ClassVar[Room] = Room(1000, 64 << 20)
    droppable: ClassVar[tuple[type[Event], ...]] = ()
    newest_suffice: ClassVar[bool] = False
    slowest: ClassVar[float] = 0.0

    Options: ClassVar[type[BaseModel]] = NoOptions
    """What a configuration may set, checked."""

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = options if options is not None else self.Options()
        self.abandoned = Flag()

    def open(self) -> None:
        """Get ready; the latest `lasting` events come next."""

    def take(self, event: Event) -> None:
        """Work an event off."""

    def close(self) -> None:
        """Finish what was begun."""

    def discard(self) -> None:
        """Leave nothing of what was begun; where that means nothing, the same as `close`."""
        self.close()

    def abandon(self) -> None:
        """Let go of processes and the like; called by another thread while this one hangs: never wait."""

    @property
    def files(self) -> tuple[str, ...]:
        """What it has written, complete."""
        return ()

    @property
    def losses(self) -> tuple[str, ...]:
        """What got lost in it, in words."""
        return ()
