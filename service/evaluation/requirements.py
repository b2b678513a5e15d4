"""Requirements on figures of quality: `flatness<3mm`."""

import re
from dataclasses import dataclass
from operator import ge, gt, le, lt

from service.errors import ConfigurationError

LENGTHS = ("flatness", "noise", "repeatability", "bias", "step", "edge")
"""Figures in metres."""

SHARES = ("fill",)
"""Figures from 0 to 1."""

_RELATIONS = {"<": lt, "<=": le, ">": gt, ">=": ge}
_UNITS = {"m": 1.0, "mm": 1e-3, "%": 1e-2}

_FORM = re.compile(
    r"\s*(?P<name>\w+)\s*(?P<relation><=|>=|<|>)\s*(?P<number>\d+\.?\d*(e[+-]?\d+)?|\.\d+)\s*(?P<unit>mm|m|%|)\s*"
)


@dataclass(frozen=True)
class Requirement:
    """What a figure after fusion has to be.

    Attributes:
        text: as it was given.
        name: of the figure.
        relation: `<`, `<=`, `>` or `>=`.
        bound: metres, or a share.
    """

    text: str
    name: str
    relation: str
    bound: float

    def is_met(self, value: float) -> bool:
        """Whether a value satisfies it; of a bias its size counts."""
        return bool(_RELATIONS[self.relation](abs(value), self.bound))


def parse_requirement(text: str) -> Requirement:
    """Read `NAME RELATION NUMBER UNIT`, as `flatness<3mm` or `fill>=95%`.

    Raises:
        ConfigurationError: another form, an unknown name, no unit, or one that is none of this figure.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise ConfigurationError(
            f"--require {text!r}: expected a figure, one of < <= > >=, and a number in m, mm or %, such as "
            "flatness<3mm or fill>95%"
        )
    name, unit = found["name"], found["unit"]
    if name not in LENGTHS + SHARES:
        raise ConfigurationError(
            f"--require {text!r}: no figure is called {name!r}; there are: {', '.join(LENGTHS + SHARES)}"
        )
    if not unit or (unit == "%") is not (name in SHARES):  # a bare 3 would be metres, which everything meets
        wanted = "a share: give %" if name in SHARES else "a length: give m or mm"
        raise ConfigurationError(f"--require {text!r}: {name} is {wanted}")
    return Requirement(text, name, found["relation"], float(found["number"]) * _UNITS[unit])
