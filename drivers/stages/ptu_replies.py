"""What a Directed Perception / FLIR pan-tilt unit says, cut out of a noisy byte stream.

A command is answered by `*`, a query by `* <text>`, a refusal by `! <text>`, each ended by CR or CR LF. In
between, unasked, come `!P` and `!T` (an axis has hit a limit) and `!D` (the head's cable came off). In
verbose mode the text names its quantity, as in `Current Pan position is 1000`, so that no answer can be taken
for another's; the words are those of the PTU-D46 (v2.14) and PTU-D300 (v2.18) manuals and of public drivers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

_EVENT = re.compile(rb"!([PTD])(?=[\s!*])")
_EVENT_AT_END = re.compile(rb"!([PTD])$")
_ANSWER = re.compile(rb"([*!])([^\r\n]*)[\r\n]")
_START = re.compile(rb"[*!]")
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?![\d.])")

_AXES = {"P": "pan", "T": "tilt"}
_QUANTITIES = {
    "P": r"current {} position",
    "N": r"minimum {} position",
    "X": r"maximum {} position",
    "S": r"target {} speed",
    "U": r"maximum {} speed",
    "L": r"minimum {} speed",
    "A": r"{} acceleration",
    "R": r"seconds arc per",
}
VERSION, LIMITS = "V", "L"
_TEXTS = {VERSION: re.compile(r"\bv ?\d+\.\d", re.I), LIMITS: re.compile(r"limit bounds are", re.I)}
UNNAMED = ("PR", "TR")
"""Queries whose answers do not name their axis."""


def answers(query: str, text: str) -> bool:
    """Whether a verbose text is the answer to a query such as `PP`, `TN`, `V`."""
    if query in _TEXTS:
        return _TEXTS[query].search(text) is not None
    words = _QUANTITIES[query[1]].format(_AXES[query[0]])
    return re.search(rf"\b{words}\b", text, re.I) is not None


@dataclass(frozen=True, slots=True)
class Reply:
    """One thing said by the unit.

    Attributes:
        kind: `done` (`*`), `refused` (`!`), or an `event`.
        text: what follows the sign; the letter of an event.
        before: bytes that came before it: an echo, a banner, noise.
    """

    kind: Literal["done", "refused", "event"]
    text: str
    before: bytes

    @property
    def number(self) -> float | None:
        """The only number in the text; None where there is none, or where noise got into the text."""
        found = _NUMBER.findall(self.text.partition("/sec")[0])
        clean = self.text.isascii() and self.text.isprintable()
        return float(found[0]) if clean and len(found) == 1 else None

    def fits(self, query: str) -> bool:
        """Whether the text answers a query, or the bare `*` a command (empty)."""
        if not query:
            return not self.text
        return answers(query, self.text) and (query in _TEXTS or self.number is not None)


class Replies:
    """Cuts replies out of bytes as they arrive."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> None:
        """Add bytes that have arrived."""
        self._buffer += data

    def clear(self) -> None:
        """Forget what has not been taken."""
        self._buffer = b""

    def take(self, query: bool, final: bool = False) -> Reply | None:
        """The next reply, or None where the bytes hold none yet.

        Args:
            query: a text is awaited after the `*`. Without it, a bare `*` is a reply before its line ends,
                as in the answer to a reset.
            final: nothing more is coming for now, so that a trailing `!P` is an event and not a refusal
                cut short.
        """
        start = _START.search(self._buffer)
        if start is None:
            return None
        before, rest = self._buffer[: start.start()], self._buffer[start.start() :]
        event = _EVENT.match(rest) or (_EVENT_AT_END.match(rest) if final else None)
        if event is not None:
            return self._take("event", event[1], before, rest[event.end() :])
        answer = _ANSWER.match(rest)
        if answer is None:
            if rest == b"*" and not query and final:
                return self._take("done", b"", before, b"")
            return None
        text = answer[2].rpartition(b"*")[2].strip()  # noise may hold a star of its own
        return self._take("refused" if answer[1] == b"!" else "done", text, before, rest[answer.end() :])

    def _take(
        self, kind: Literal["done", "refused", "event"], text: bytes, before: bytes, rest: bytes
    ) -> Reply:
        self._buffer = rest
        return Reply(kind, text.decode("ascii", "replace"), before)


def cut(said: bytes) -> list[Reply]:
    """All replies in what was said."""
    replies, found = Replies(), []
    replies.feed(said)
    while (reply := replies.take(query=True, final=True)) is not None:
        found.append(reply)
    return found
