"""Text on a terminal is shown as it is: nothing in a path is markup."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rich.progress import TimeElapsedColumn
from rich.table import Table

import service
from service.cli.counter import counted
from service.cli.fuse import _progress
from service.cli.terminal import bar, console, spinner

NAME = "scan[1]_[red]_:smile:.mcap"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@contextmanager
def terminal() -> Iterator[Terminal]:
    """Stands for both outputs."""
    screen = Terminal()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TERM", "xterm")
        patch.setenv("COLUMNS", "200")
        patch.delenv("NO_COLOR", raising=False)
        patch.setattr(sys, "stdout", screen)
        patch.setattr(sys, "stderr", screen)
        yield screen


def test_a_line_and_a_cell() -> None:
    with terminal() as screen:
        console().print(f"wrote {NAME}")
        assert f"wrote {NAME}" in screen.getvalue()
        table = Table("Where")
        table.add_row(NAME)
        console(stderr=True).print(table)
        assert screen.getvalue().count(NAME) == 2


def test_what_a_bar_describes() -> None:
    with terminal() as screen:
        with bar(TimeElapsedColumn(), NAME.upper()) as shown:
            shown.add_task(NAME, total=3)
        assert NAME in screen.getvalue()
        assert NAME.upper() in screen.getvalue()


def test_what_a_spinner_tells() -> None:
    with terminal() as screen:
        with spinner("evaluating") as tell:
            tell(NAME)
        assert NAME in screen.getvalue()


def test_a_recording_that_is_fused_and_its_results() -> None:
    with terminal() as screen:
        with _progress(Path("folder") / NAME, quiet=False) as (begun, _, tell):
            begun(3)
            tell(f"wrote {NAME}")
        assert f"wrote {NAME}" in screen.getvalue()
        assert screen.getvalue().count(NAME) > 1


def test_what_is_counted() -> None:
    with terminal() as screen:
        with counted(2, f"importing {NAME}") as advance:
            advance()
            advance()
        assert f"importing {NAME}" in screen.getvalue()


def test_no_other_module_draws_for_itself() -> None:
    root = Path(next(iter(service.__path__)))
    drawing = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        if any(
            word in path.read_text() for word in ("rich.console", "TextColumn", "rich.print", "rich.status")
        )
    }
    assert drawing == {"cli/terminal.py"}
