"""Messages between Zenoh's threads and the one that grabs."""

import time
from collections import Counter, deque
from threading import Condition
from typing import NamedTuple

import zenoh

from drivers.clock import Clock

ROOM = 64
"""Messages that wait; of a camera of 30 frames/s with amplitude and fields, 0.7 s."""


class Letter(NamedTuple):
    """One message: which subscription, how many came before, key, encoding, and when it came, ns."""

    role: str
    number: int
    key: str
    encoding: str
    payload: zenoh.ZBytes
    arrived: int


class Mailbox:
    """Bounded; the oldest image goes when it is full. Optics are few and are never dropped.

    Attributes:
        has_dropped: whether images had to go since it was made or cleared.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._changed = Condition()
        self._letters: deque[Letter] = deque()
        self._numbers: Counter[str] = Counter()
        self.has_dropped = False

    def put(self, role: str, sample: zenoh.Sample) -> None:
        """Take a message."""
        what = str(sample.key_expr), str(sample.encoding), sample.payload
        with self._changed:
            self._letters.append(Letter(role, self._numbers[role], *what, self._clock.now()))
            self._numbers[role] += 1
            if len(self._letters) > ROOM:
                self._drop()
            self._changed.notify_all()

    def get(self, timeout: float) -> Letter | None:
        """The oldest message, or None where none comes within `timeout` seconds."""
        deadline = time.monotonic() + timeout
        with self._changed:
            while not self._letters:
                left = deadline - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    return self._letters.popleft() if self._letters else None
            return self._letters.popleft()

    def forget_images(self) -> None:
        """Throw away what waits, but for optics."""
        with self._changed:
            self._letters = deque(letter for letter in self._letters if letter.role == OPTICS)
            self.has_dropped = False

    def _drop(self) -> None:
        for place, letter in enumerate(self._letters):
            if letter.role != OPTICS:
                del self._letters[place]
                self.has_dropped = True
                return


OPTICS = "optics"
