"""How long maps take from the exposure to the hands of subscribers, as far as those send receipts."""

import time
from collections import OrderedDict, deque
from collections.abc import Callable
from statistics import median
from threading import Lock

import zenoh
from pydantic import ValidationError

from service.allowance import Allowance
from service.messages.receipt import RECEIPT, Receipt
from service.messages.status import Subscriber

_MAPS = 64
"""Maps for which receipts are taken; a stream makes so many in some seconds."""

_SUBSCRIBERS, _LAST = 16, 20
"""Subscribers that are told of, and receipts of each that count."""

_SILENCE = 30.0
"""Seconds without a receipt after which a subscriber is forgotten."""

_PER_SECOND, _BURST, _BYTES = 500.0, 1000.0, 1000
"""Receipts that are looked at, in the long run and at once, and how long one may be."""


class Receipts:
    """Takes receipts; the way back counts as part of the latency, so that clocks need not agree.

    Args:
        session: open; it must outlive this.
        prefix: of every key.
        clock: seconds.
    """

    def __init__(
        self, session: zenoh.Session, prefix: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock, self._lock = clock, Lock()
        self._exposed: OrderedDict[int, float] = OrderedDict()
        self._of: OrderedDict[tuple[str, str, str], deque[tuple[float, float]]] = OrderedDict()
        self._allowance = Allowance(_PER_SECOND, _BURST)
        self._declared = session.declare_subscriber(f"{prefix}/{RECEIPT}/*", self._arrived)

    def undeclare(self) -> None:
        """Take no more."""
        self._declared.undeclare()  # type: ignore[no-untyped-call]

    def expect(self, timestamp: int, exposed: float) -> None:
        """A map is about to be published.

        Args:
            timestamp: that its messages bear.
            exposed: when its last exposure ended, seconds of the clock.
        """
        with self._lock:
            self._exposed[timestamp] = exposed
            while len(self._exposed) > _MAPS:
                self._exposed.popitem(last=False)

    @property
    def subscribers(self) -> tuple[Subscriber, ...]:
        """Whoever sent receipts in the last half minute."""
        with self._lock:
            now = self._clock()
            for key in [key for key, taken in self._of.items() if now - taken[-1][0] > _SILENCE]:
                del self._of[key]
            return tuple(
                Subscriber(
                    who=who,
                    topic=topic,
                    latency=median(latency for _, latency in taken),
                    slowest=max(latency for _, latency in taken),
                    seconds=now - taken[-1][0],
                )
                for (_, who, topic), taken in self._of.items()
            )

    def _arrived(self, sample: zenoh.Sample) -> None:
        arrived = self._clock()
        if len(sample.payload) > _BYTES or not self._allowance.spend():
            return
        try:
            receipt = Receipt.model_validate_json(sample.payload.to_bytes())
        except ValidationError:
            return  # a stranger's
        self.take(str(sample.key_expr).rpartition("/")[2], receipt, arrived)

    def take(self, session: str, receipt: Receipt, arrived: float) -> None:
        """Take one of a Zenoh session's; of a map that is not known it counts for nothing."""
        with self._lock:
            exposed = self._exposed.get(receipt.timestamp)
            if exposed is None:
                return
            taken = self._of.setdefault((session, receipt.who, receipt.topic), deque(maxlen=_LAST))
            taken.append((arrived, arrived - exposed))
            while len(self._of) > _SUBSCRIBERS:
                self._of.popitem(last=False)
