"""The table of commands: one module each, which defines `COMMAND`; whatever lies in this folder is in it."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from service.daemon.verb import Command


@cache
def commands() -> dict[str, Command]:
    """Every command by name."""
    names = sorted(module.name for module in iter_modules(__path__))
    found = [import_module(f"{__name__}.{name}").COMMAND for name in names]
    return {command.name: command for command in found}


def command_table() -> str:
    """The table as Markdown, as it stands on the page for subscribers."""
    lines = ["| command | actions | what |", "|---|---|---|"]
    for command in commands().values():
        actions = ", ".join(f"`{action}`" for action in command.actions)
        lines.append(f"| `{command.name}` | {actions} | {command.description} |")
    return "\n".join(lines)
