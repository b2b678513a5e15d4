"""How the service is doing: the payload of `status`, and the rates in it."""

import time
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from service.output.recorder import RecorderState

State = Literal["starting", "scanning", "streaming", "idle", "recovering", "stopping"]
Source = Literal["device", "replay", "simulation"]

_WINDOW = 10.0
"""Seconds over which rates are taken: at one burst in some seconds a shorter window would jump."""


class _Part(BaseModel):
    """Read too: what a newer service adds is passed over, what an older one lacks has its default."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class Drops(_Part):
    """What was lost since the service started, by cause."""

    camera: int = Field(0, ge=0, description="Frames that the camera took and that never arrived.")
    stale: int = Field(0, ge=0, description="Frames exposed before the stage stood still; not a fault.")
    faults: int = Field(0, ge=0, description="Frames or movements that failed and were tried again.")
    bursts: int = Field(0, ge=0, description="Bursts given up or skipped because fusion was behind.")
    fusions: int = Field(0, ge=0, description="Bursts whose fusion failed.")
    published: int = Field(0, ge=0, description="Messages that the publisher had no room for.")
    recorded: int = Field(0, ge=0, description="Messages that the recorder had no room for.")


class Totals(_Part):
    """What was done since the service started."""

    frames: int = Field(0, ge=0, description="Frames captured.")
    bursts: int = Field(0, ge=0, description="Bursts completed.")
    fused: int = Field(0, ge=0, description="Maps fused.")


class Rates(_Part):
    """How fast, over the last ten seconds."""

    frames: float = Field(0.0, ge=0, description="Frames per second.")
    fused: float = Field(0.0, ge=0, description="Maps per second.")


class Status(_Part):
    """How the service is doing; once a second."""

    timestamp: int = Field(0, description="When this was true, ns since the epoch.")
    version: str = Field("unknown", description="Version of the software.")
    state: State | str = Field("unknown", description="What it is doing.")
    source: Source | str | None = Field(
        None, description="Where frames come from; none while there is no camera."
    )
    model: str | None = Field(None, description="What the camera is.")
    serial: str | None = Field(None, description="Its serial number.")
    uptime: float = Field(0.0, ge=0, description="Seconds since the start.")
    totals: Totals = Totals()
    rates: Rates = Rates()
    drops: Drops = Drops()
    backlog: int = Field(0, ge=0, description="Bursts that wait for fusion.")
    latency: float | None = Field(
        None, description="Seconds from the last frame of the last burst to its map."
    )
    recorder: RecorderState | None = Field(None, description="What is recorded; none = no recorder.")
    error: str | None = Field(None, description="The last error; none = all well so far.")


class Meter:
    """Events per second over the last ten seconds; may be used from several threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._events: deque[float] = deque()
        self._lock = Lock()

    def tick(self) -> None:
        """Count an event."""
        with self._lock:
            self._events.append(self._clock())
            self._forget()

    @property
    def rate(self) -> float:
        """Events per second; while younger than the window, over its own age."""
        with self._lock:
            self._forget()
            span = min(_WINDOW, self._clock() - self._began)
            return len(self._events) / span if span > 0 else 0.0

    def _forget(self) -> None:
        oldest = self._clock() - _WINDOW
        while self._events and self._events[0] < oldest:
            self._events.popleft()
