"""Values that no field should hold, and documents in which one or two fields hold them."""

import copy
from collections.abc import Iterator
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

PROFILE = settings(
    max_examples=80, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), database=None
)


def nested(depth: int) -> list[Any]:
    found: list[Any] = []
    for _ in range(depth):
        found = [found]
    return found


INTEGERS = (0, -1, 1, 2, 3, 10**9, 2**31, 2**63, 2**64, -(2**63), 10**30, 10**400, 16**900)
FLOATS = (float("nan"), float("inf"), -float("inf"), 0.0, -0.0, -1.0, 5e-324, 1e-300, 1e300, 1e9)
TEXTS = ("", "x", "1", "nan", "\0", "ä\ud800", "a" * 3000)
LISTS = ([], {}, [0], [1.0] * 3, [[1.0] * 3] * 3, {"x": 1}, nested(20), nested(60))

VALUES: st.SearchStrategy[Any] = st.one_of(
    st.sampled_from([*INTEGERS, *FLOATS, *TEXTS, *LISTS, True, False]),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
)


def places(document: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something stands in a document."""
    inner = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in inner:
        yield (*at, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*at, key))


@st.composite
def damaged(draw: st.DrawFn, document: dict[str, Any]) -> dict[str, Any]:
    """The document with one or two entries replaced, taken out or added."""
    found = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 2))):
        *above, key = draw(st.sampled_from(list(places(found))))
        inner = found
        for step in above:
            inner = inner[step]
        match draw(st.sampled_from(["replace", "replace", "replace", "take out", "add"])):
            case "replace":
                inner[key] = copy.deepcopy(draw(VALUES))
            case "take out":
                del inner[key]
            case "add" if isinstance(inner, dict):
                inner[draw(st.sampled_from(["x", "model", "fx"]))] = copy.deepcopy(draw(VALUES))
    return found


@st.composite
def torn(draw: st.DrawFn, content: bytes) -> bytes:
    """The bytes cut off, or with some of them changed."""
    changed = bytearray(content[: draw(st.integers(0, len(content)))] if draw(st.booleans()) else content)
    for _ in range(draw(st.integers(0, 3)) if changed else 0):
        changed[draw(st.integers(0, len(changed) - 1))] = draw(st.integers(0, 255))
    return bytes(changed)


def toml(value: Any) -> str:
    """A value in TOML, whatever it holds: written by hand, since libraries refuse some of it."""
    match value:
        case dict():
            pairs = (f"{quoted(str(key))} = {toml(inner)}" for key, inner in value.items())
            return "{" + ", ".join(pairs) + "}"
        case list():
            return "[" + ", ".join(map(toml, value)) + "]"
        case bool():
            return str(value).lower()
        case int():
            return str(value) if abs(value) < 10**500 else hex(value)
        case float():
            return repr(value)
    return quoted(str(value))


def toml_document(document: dict[str, Any]) -> bytes:
    lines = (f"{quoted(str(key))} = {toml(value)}\n" for key, value in document.items())
    return "".join(lines).encode("utf-8", "surrogatepass")


def quoted(text: str) -> str:
    escaped = (c if c.isalnum() or ord(c) >= 65536 else f"\\u{ord(c):04x}" for c in text)
    return f'"{"".join(escaped)}"'


def assert_one_clear_line(error: Exception, origin: str = "") -> None:
    said = str(error)
    assert said.startswith(origin)
    assert said.strip()
    assert "\n" not in said
    assert len(said) < 3000
