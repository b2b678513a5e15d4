"""The pages' tables are made of what benchmarks have stored."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent / "benchmarks"


def test_every_table_of_a_page_holds_what_is_stored() -> None:
    command = [sys.executable, str(BENCHMARKS / "figures.py"), "--check"]
    said = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    remedy = "run python tests/benchmarks/figures.py"
    assert said.returncode == 0, f"{said.stdout}{said.stderr}{remedy}"


def test_a_table_that_differs_is_told_and_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    from figures import filled

    page = "before\n<!-- figures: recordings -->\n| somebody's | guess |\n<!-- end -->\nafter\n"
    made = filled(page)
    assert made != page
    assert "guess" not in made
    assert made.startswith(
        "before\n<!-- figures: recordings -->\n| RMS / mean absolute error, mm | wedges | objects |"
    )
    assert made.endswith("<!-- end -->\nafter\n")
    assert filled(made) == made
