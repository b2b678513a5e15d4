"""Presets: sets of ordinary settings by name, under whatever is set explicitly."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

_LONG, _SHORT = 0.025, 0.005
"""Integration times, seconds: the longest that every known camera takes (an SR4000 ends at 25.8 ms), and one
of 50 frames/s."""

PRESETS: dict[str, dict[str, Any]] = {
    "fine": {
        "camera": {"settings": {"integration_time": _LONG}},
        "fusion": {"frames": 30, "upsampling": 4, "tolerance": 1e-4},
    },
    "fast": {
        "camera": {"settings": {"integration_time": _SHORT}},
        "fusion": {"frames": 8, "upsampling": 2, "method": "lidarboost"},
        "stream": {"window": 8},
    },
    "far": {
        "camera": {"settings": {"integration_time": _LONG, "amplitude_threshold": 0}},
        "fusion": {"frames": 40, "upsampling": 3},
    },
    "dark": {
        "camera": {"settings": {"integration_time": _LONG, "amplitude_threshold": 0}},
        "fusion": {"frames": 40, "upsampling": 2, "amplitude_threshold": 0.0, "fill": 8.0},
    },
}
"""`fine`: as much detail and as little noise as there is time for. `fast`: many maps a second, half as fine.
`far`: things whose light is weak for being far away. `dark`: things that return little light: no sample is
left out for its amplitude, and gaps are filled further. None changes the modulation frequency, for a
calibration holds for one; beyond the ambiguity range lower it yourself."""

DESCRIPTIONS = {
    "fine": "much detail and little noise, where there is time",
    "fast": "many maps a second, half as fine",
    "far": "things that are far away",
    "dark": "things that return little light",
}
"""What each is for."""


def settings_of(preset: str) -> Iterator[tuple[str, Any]]:
    """Key, as `fusion.frames`, and value of each setting of a preset."""
    yield from _flat(PRESETS[preset], ())


def describe(preset: str, configuration: BaseModel | None = None) -> str:
    """What a preset sets, in one line; with a configuration also what is set to something else there."""
    said = []
    for key, value in settings_of(preset):
        used = value if configuration is None else _looked_up(configuration, key)
        kept = "" if used == value else f" (stays {used}: set explicitly)"
        said.append(f"{key} = {value}{kept}")
    return f"preset {preset}: {', '.join(said)}"


def _flat(values: Mapping[str, Any], keys: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, (*keys, name))
        else:
            yield ".".join((*keys, name)), value


def _looked_up(found: Any, key: str) -> Any:
    for name in key.split("."):
        found = getattr(found, name, None)
    return found
