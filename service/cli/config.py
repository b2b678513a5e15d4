"""`lidarboost config`: check a configuration file, or show what it may hold."""

from pathlib import Path
from typing import Annotated

import typer

config = typer.Typer(
    no_args_is_help=True, help="Check a configuration, or show its schema.", rich_markup_mode="rich"
)


@config.command()
def check(
    file: Annotated[
        Path | None, typer.Argument(help="Configuration, TOML; none = the defaults and the environment.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the configuration in force as JSON.")
    ] = False,
) -> None:
    """Check a configuration: file, environment, and the options of camera, stage and sinks that it names.

    Opens no device. Prints the configuration in force, as TOML; what is
    secret in it is hidden.

    [bold]Examples[/bold]

      lidarboost config check rig.toml

      LIDARBOOST_FUSION__METHOD=area lidarboost config check --json

    [bold]Exit status[/bold]  0 it can be used; 2 it cannot, and standard error says where and why
    """
    import json

    import tomli_w

    from service.capture.configured import check_options
    from service.config.file import load
    from service.config.secrets import without_secrets
    from service.sinks.configured import configured_sinks

    found = load(file)
    check_options(found)
    configured_sinks(found.sinks)
    shown = without_secrets(found.model_dump(mode="json", exclude_none=not as_json))
    print(json.dumps(shown, indent=2, ensure_ascii=False) if as_json else tomli_w.dumps(shown).rstrip())


@config.command()
def presets() -> None:
    """List the presets, with what each sets: `preset = "fine"` in the configuration, or --preset fine.

    Whatever is set explicitly goes before them.
    """
    from service.config.presets import DESCRIPTIONS, describe

    for name, purpose in DESCRIPTIONS.items():
        print(f"{describe(name)}  # {purpose}")


@config.command()
def schema() -> None:
    """Print the JSON schema of the configuration: every key with its unit, bounds, default and meaning.

    With the options of every camera and stage backend that can be loaded here.

    [bold]Example[/bold]  lidarboost config schema > lidarboost.schema.json
    """
    import json

    from service.config.schema import schema as found

    print(json.dumps(found(), indent=2, ensure_ascii=False))
