"""What a user's Zenoh file says, which goes before our own settings even where it names a default."""

import re
from pathlib import Path
from typing import Any

import json5
import zenoh

from service.errors import SessionError

_QUOTED_LINE = re.compile(r"\s*\d*\s*\|")
_REMOVED = (
    (re.compile(r" at /\S+\.rs:\d+\.?"), ""),
    (re.compile(r"\b(integer|string|floating point|boolean|character) (\\?[`\"]).*?\2"), r"\1"),
    (re.compile(r"#[^\s\"',\]]*=[^\s\"',\]]+"), ""),
)


class ZenohFile:
    """A configuration of Zenoh, and whether its file says a setting.

    Attributes:
        config: the file's settings, and Zenoh's defaults for all others.

    Raises:
        SessionError: the file cannot be read, or Zenoh refuses it.
    """

    def __init__(self, file: Path | None) -> None:
        self._untouched = zenoh.Config()
        self._document: Any = None
        try:
            self.config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
            if file is not None and file.suffix != ".yaml":
                self._document = json5.loads(file.read_text(encoding="utf-8-sig"))
        except (zenoh.ZError, OSError, ValueError, RecursionError) as error:
            raise SessionError(f"{file}: not a Zenoh configuration (JSON5): {brief(str(error))}") from error

    def says(self, key: str) -> bool:
        """Whether the file says a setting, such as `transport/link/tcp/so_sndbuf`.

        What it sets to null it does not say: that is how Zenoh writes what is open. Of a file in YAML only
        the values are known: there a default counts as not said.
        """
        if self._document is None:
            return bool(self.config.get_json(key) != self._untouched.get_json(key))
        value = self._document
        for name in key.split("/"):
            value = value.get(name) if isinstance(value, dict) else None
        return value is not None


def brief(error: str) -> str:
    """Zenoh's message on one line, without the source lines of its own code, and without what may be secret:
    the line of the file that it quotes, values, and what follows the address in an endpoint."""
    kept = "\n".join(line for line in error.splitlines() if not _QUOTED_LINE.match(line))
    for pattern, instead in _REMOVED:
        kept = pattern.sub(instead, kept)
    return " ".join(kept.split())
