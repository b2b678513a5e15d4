"""What must not be shown: values whose key says that they are secret, and passwords in addresses."""

import re
from typing import Any

HIDDEN = "(hidden)"

_KEY = re.compile(
    r"pass(word|wd|phrase)|secret|token|credential|api_?key|private_?key|_base64|^key$", re.IGNORECASE
)
_PLACE = re.compile(r"file|path", re.IGNORECASE)
"""Where a secret lies is none."""

_IN_ADDRESS = re.compile(r"(?<=://)[^/@\s]*:[^/@\s]*(?=@)")
"""User and password of `https://user:password@host` (RFC 3986, 3.2.1)."""


def is_secret(key: str) -> bool:
    """Whether the value of a key is to be hidden."""
    return _KEY.search(key) is not None and _PLACE.search(key) is None


def without_secrets(value: Any) -> Any:
    """The same with what is secret in it replaced; for plain values: dictionaries, lists, text, numbers."""
    if isinstance(value, dict):
        return {
            key: HIDDEN if is_secret(str(key)) else without_secrets(inner) for key, inner in value.items()
        }
    if isinstance(value, list):
        return [without_secrets(inner) for inner in value]
    return _IN_ADDRESS.sub(HIDDEN, value) if isinstance(value, str) else value
