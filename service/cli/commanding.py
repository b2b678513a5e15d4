"""What the commands share that ask something of a running service."""

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from service.wire.asking import Answer

AsJson = Annotated[bool, typer.Option("--json", help="The reply as it came.")]


def state_of(answer: "Answer") -> str:
    """The state in a few words."""
    paused = ", paused" if answer.get("paused") else ""
    return f"{answer['state']}{paused}: {answer['reason']}"


def say(answer: "Answer", as_json: bool, describe: "Callable[[Answer], str]" = state_of) -> None:
    """The reply, as JSON or in words."""
    print(json.dumps(answer, indent=2) if as_json else describe(answer))


def add_verb(
    app: typer.Typer,
    name: str,
    action: str,
    summary: str,
    seconds: float = 10.0,
    describe: "Callable[[Answer], str]" = state_of,
) -> None:
    """Give an app a verb without arguments.

    Args:
        app: of the command.
        name: such as `cmd/scan`.
        action: its verb.
        summary: what it does.
        seconds: that it may take.
        describe: the reply in words.
    """

    @app.command(action, help=summary)
    def verb(
        endpoint: Endpoint = DEFAULT_ENDPOINT,
        prefix: Prefix = DEFAULT_PREFIX,
        timeout: Timeout = seconds,
        as_json: AsJson = False,
    ) -> None:
        with connected(endpoint, prefix) as rig:
            say(rig.command(name, action, timeout), as_json, describe)


def fields_of(pairs: list[str]) -> dict[str, Any]:
    """`FIELD=VALUE` as a dictionary; values are JSON where they can be, else text."""
    found = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not (name and equals) or name == "action":
            raise typer.BadParameter(f"{pair}: expected FIELD=VALUE, such as span=2.0")
        try:
            found[name] = json.loads(value)
        except ValueError:
            found[name] = value
    return found
