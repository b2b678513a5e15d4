"""What the service is doing, why, and what does not work meanwhile."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock

from service.messages.events import Event, StateChanged
from service.messages.status import Degraded, State


@dataclass(frozen=True, slots=True)
class _Fault:
    what: str
    remedy: str
    since: float


class States:
    """The state with its reason and its age, and beside it the list of what is degraded.

    Args:
        emit: told of every change of state.
        clock: seconds.

    Attributes:
        changed: called after every change, also of what is degraded.
    """

    def __init__(
        self, emit: Callable[[Event], None] = lambda _: None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.changed: Callable[[], None] = lambda: None
        self._emit, self._clock = emit, clock
        self._lock = Lock()
        self._state: State = "starting"
        self._reason = "the devices are being opened"
        self._since = clock()
        self._faults: dict[str, _Fault] = {}

    @property
    def state(self) -> State:
        return self._state

    @property
    def reason(self) -> str:
        """Why it is in that state."""
        return self._reason

    @property
    def seconds(self) -> float:
        """For how long."""
        return self._clock() - self._since

    @property
    def degraded(self) -> tuple[Degraded, ...]:
        """What does not work, the longest first."""
        with self._lock:
            faults = sorted(self._faults.values(), key=lambda fault: fault.since)
            now = self._clock()
        return tuple(Degraded(what=f.what, remedy=f.remedy, seconds=now - f.since) for f in faults)

    def enter(self, state: State, reason: str) -> None:
        """Go to a state; its age begins anew where it is another one. Nothing comes after `stopping`."""
        with self._lock:
            if self._state == "stopping" or (state, reason) == (self._state, self._reason):
                return
            if state != self._state:
                self._since = self._clock()
            self._state, self._reason = state, reason
        self._emit(StateChanged(state, reason))
        self.changed()

    def degrade(self, part: str, what: str, remedy: str) -> None:
        """Something of a part does not work; it is said until `mend`."""
        with self._lock:
            before = self._faults.get(part)
            fault = _Fault(what, remedy, self._clock() if before is None else before.since)
            self._faults[part] = fault
        if fault != before:
            self.changed()

    def mend(self, part: str) -> None:
        """The part works again."""
        with self._lock:
            before = self._faults.pop(part, None)
        if before is not None:
            self.changed()
