"""The option `--preset`, and the configuration with it: what it sets is told."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from service.config.sections import Configuration

PresetOption = Annotated[
    str | None,
    typer.Option("--preset", help="fine, fast, far or dark: settings under those given explicitly."),
]


def configured(
    path: Path | None, preset: str | None, flags: Mapping[str, Any] | None = None
) -> "Configuration":
    """The configuration in force; says on standard error what its preset sets.

    Raises:
        ConfigurationError: as `load`; also a preset that is none.
    """
    from service.config.file import load
    from service.config.presets import describe

    named = {} if preset is None else {"preset": preset}
    found = load(path, {**(flags or {}), **named})
    if found.preset is not None:
        print(describe(found.preset, found), file=sys.stderr)
    return found
