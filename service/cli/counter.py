"""Counts on standard error while long work goes on: a bar on a terminal, some lines elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINES = 5
"""Lines in all where there is no terminal."""


@contextmanager
def counted(total: int, what: str, noun: str = "frames") -> Iterator[Callable[[], None]]:
    """Yields what is to be called once for each of `total` items; `what` says what is done to them."""
    if not sys.stderr.isatty():
        yield _lines(total, what, noun)
        return
    from rich.progress import TimeRemainingColumn

    from service.cli.terminal import bar

    with bar(TimeRemainingColumn(), noun) as shown:
        task = shown.add_task(what, total=total)
        yield lambda: shown.advance(task)


def _lines(total: int, what: str, noun: str) -> Callable[[], None]:
    done = 0

    def count() -> None:
        nonlocal done
        done += 1
        if done % max(1, total // LINES) == 0 or done == total:
            print(f"{what}: {done} of {total} {noun}", file=sys.stderr)

    return count
