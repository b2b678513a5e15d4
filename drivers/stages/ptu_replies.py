"""What a Directed Perception / FLIR pan-tilt unit says, cut out of a noisy byte stream.

A command is answered by `*`, a query by `* <text>`, a refusal by `! <text>`, each ended by CR or CR LF. In
between, unasked, come `!P` and `!T` (an axis has hit a limit) and `!D` (the head's cable came off).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

_EVENT = re.compile(rb"!([PTD])(?=[\s!*])")
_EVENT_AT_END = re.compile(rb"!([PTD])$")
_ANSWER = re.compile(rb"([*!])([^\r\n]*)[\r\n]")
_START = re.compile(rb"[*!]")
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


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
        """The first number in the text; None where there is none, or where noise got into the text."""
        found = _NUMBER.search(self.text)
        clean = self.text.isascii() and self.text.isprintable()
        return float(found[0]) if clean and found is not None else None

    @property
    def verbose(self) -> bool:
        """Whether it speaks in words, which a unit in terse mode does not."""
        return any(letter.isalpha() for letter in self.text)


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
                as in the answer to a reset; with it, a `*` without text is a late answer and is skipped.
            final: nothing more is coming for now, so that a trailing `!P` is an event and not a refusal
                cut short.
        """
        while start := _START.search(self._buffer):
            before, rest = self._buffer[: start.start()], self._buffer[start.start() :]
            event = _EVENT.match(rest) or (_EVENT_AT_END.match(rest) if final else None)
            if event is not None:
                return self._take("event", event[1], before, rest[event.end() :])
            if rest.startswith(b"*") and not query:
                return self._take("done", b"", before, rest[1:])
            answer = _ANSWER.match(rest)
            if answer is None:
                return None
            text = answer[2].rpartition(b"*")[2].strip()  # noise may hold a star of its own
            if answer[1] == b"!":
                return self._take("refused", text, before, rest[answer.end() :])
            if text:
                return self._take("done", text, before, rest[answer.end() :])
            self._buffer = before + rest[answer.end() :]
        return None

    def _take(
        self, kind: Literal["done", "refused", "event"], text: bytes, before: bytes, rest: bytes
    ) -> Reply:
        self._buffer = rest
        return Reply(kind, text.decode("ascii", "replace"), before)
