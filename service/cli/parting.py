"""How `run` ends the process where something does not let go of it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from service.cli import DATA_LOST, DONE, INTERRUPTED
from service.leaving import within

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_SAYING = 0.2
"""Seconds for the last words."""


class Parting:
    """Ends the process though something holds it.

    Args:
        once: one pass.

    Attributes:
        daemon: once there is one.
    """

    def __init__(self, once: bool) -> None:
        self._once = once
        self.daemon: Daemon | None = None

    def leave(self, lost: Sequence[str]) -> None:
        """End it with what was lost."""
        within(_SAYING, lambda: self._say(lost), "last words")  # a terminal may be stopped
        nothing = self.daemon is None or self.daemon.ledger.fused == 0
        os._exit(INTERRUPTED if self._once and nothing else DATA_LOST if lost else DONE)

    def give_up(self) -> None:
        """End it at once: what should have ended it hangs."""
        if self.daemon is None:
            self.leave([])
            return
        bus = self.daemon.bus
        late = [sink.name for sink in bus.states if sink.state != "ended"]
        self.leave([*bus.losses, *(f"{name}: what was not handed over in time" for name in late)])

    @staticmethod
    def _say(lost: Sequence[str]) -> None:
        for loss in lost:
            print("lost:", loss, file=sys.stderr)
        with suppress(ValueError, OSError):
            sys.stdout.flush()
            sys.stderr.flush()
