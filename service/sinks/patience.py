"""How long sinks are waited for."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Patience:
    """Seconds.

    Attributes:
        held: that a lossless run is held back by a sink, which is failed then.
        hang: that an event may take at least, before its sink counts as hanging.
        restart: before a sink is first started again.
    """

    held: float = 10.0
    hang: float = 10.0
    restart: float = 0.5
