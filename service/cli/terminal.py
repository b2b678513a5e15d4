"""What is drawn on a terminal: text as it is, for a path may hold `[…]` or `:name:` and is no markup."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn
from rich.text import Text


def console(*, stderr: bool = False) -> Console:
    """A console that prints strings as they are."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def bar(time: ProgressColumn, noun: str = "") -> Progress:
    """A bar on standard error: each task's description, how many are done, of what, and a time."""
    counted = (TextColumn(noun, markup=False),) if noun else ()
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    return Progress(
        *columns,
        *counted,
        time,
        console=console(stderr=True),
        redirect_stdout=sys.stdout.isatty(),  # what is piped on is no part of the picture
    )


@contextmanager
def spinner(text: str) -> Iterator[Callable[[str], None]]:
    """A spinner on standard error; yields what changes its text."""
    with console(stderr=True).status(Text(text)) as status:
        yield lambda line: status.update(Text(line))
