"""TOML and JSON from outside, as plain values, and what is wrong with them in words.

Both languages hold more than can be worked with: numbers of any length, lists nested without end. What is
not plain is refused here, so that nobody further on has to think of it.
"""

import json
import math
import tomllib
from collections.abc import Iterable
from itertools import islice
from typing import Any

from pydantic import ValidationError

_DEEPEST = 32
"""Lists and tables within each other; nothing here needs more than six."""

_LARGEST = 2**64
"""Integers beyond it are nobody's time or counter, and break what counts in 64 bits."""

_MOST_FAULTS = 4
"""A matrix of letters has a fault in each of its 25,344 places; the first few say it all."""


def parse_toml(content: bytes) -> dict[str, Any]:
    """The document in a TOML file, byte order mark or not; raises ValueError, which says why not."""
    try:
        found = tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ValueError(f"not a text file in UTF-8 (byte {error.start}); expected TOML") from error
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid TOML ({error})") from error
    require_plain(found)
    return found


def parse_json(content: bytes) -> Any:
    """The value in a JSON text; raises ValueError, which says why not."""
    try:
        found = json.loads(content)
    except UnicodeDecodeError as error:
        raise ValueError(f"not a text in UTF-8 (byte {error.start}); expected JSON") from error
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid JSON ({error})") from error
    require_plain(found)
    return found


def told(error: ValidationError) -> str:
    """The faults that a model found, each with the key's name; of many the first few."""
    found = error.errors(include_url=False, include_input=False, include_context=False)
    return shortened(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}".lstrip(": ") for fault in found)


def shortened(faults: Iterable[str]) -> str:
    """Faults in one line, of many the first few."""
    said = list(islice(faults, _MOST_FAULTS + 1))
    return "; ".join(said[:_MOST_FAULTS]) + ("; and more" if len(said) > _MOST_FAULTS else "")


def require_plain(value: Any) -> None:
    """Raise ValueError, which says why, for values that one of the two may hold, but nobody can work with."""
    level = [value]
    for _ in range(_DEEPEST):
        level = [inner for outer in level for inner in _checked(outer)]
        if not level:
            return
    raise ValueError(f"is nested more than {_DEEPEST} deep")


def _checked(value: Any) -> list[Any]:
    """What a value holds; level by level, since nesting must not end Python's own stack."""
    match value:
        case dict():
            return [*value, *value.values()]
        case list():
            return value
        case int() if abs(value) >= _LARGEST:
            raise ValueError("holds a number of more than 64 bits")
        case float() if not math.isfinite(value):
            raise ValueError(f"holds {value}, which is no number")
        case str() if "\0" in value:
            raise ValueError("holds a text with a null byte")
    return []
