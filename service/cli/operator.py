"""The person at the terminal, who consents to movements of the stage."""

import sys
from collections.abc import Callable
from select import select
from typing import TYPE_CHECKING

from service.capture.motion import Operator

if TYPE_CHECKING:
    from service.config.sections import Configuration


class TerminalOperator(Operator):
    """Consents by `--home`, once, or by an answer where there is a terminal.

    Args:
        home: whether `--home` was given.
        sees_log: what goes to the log need not be said again.
    """

    def __init__(self, home: bool, sees_log: bool = False) -> None:
        self._home, self._sees_log = home, sees_log

    def tell(self, what: str) -> None:
        super().tell(what)
        if not self._sees_log:
            self._say(what)

    def ask(self, question: str, interrupted: Callable[[], bool]) -> bool:
        if self._home:
            self._home = False
            return True
        if not (sys.stdin.isatty() and sys.stderr.isatty()):
            return False
        self._say(f"{question} (y = home it, anything else = do not)")
        while not interrupted():
            if select([sys.stdin], [], [], 0.1)[0]:
                return sys.stdin.readline().strip().lower() in ("y", "yes")
        return False

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)


def with_consent(configuration: "Configuration", home: bool) -> "Configuration":
    """The same configuration, where `--home` overrides that the stage is never homed."""
    if not home or configuration.stage.home != "never":
        return configuration
    stage = configuration.stage.model_copy(update={"home": "ask"})
    return configuration.model_copy(update={"stage": stage})
