"""`--help` of every command, and wrong usage."""

import subprocess
import sys
from pathlib import Path

import pytest
from typed import lidarboost

from service.cli import COMMANDS

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.usefixtures("typing_settings")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_that_teaches(name: str) -> None:
    result = lidarboost(name, "--help")
    assert result.exit_code == 0
    assert "Usage: lidarboost" in result.stdout


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from service.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'cv2', 'zenoh', 'matplotlib', 'pydantic'} & sys.modules.keys()\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    for name in COMMANDS:
        assert name in done.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("run", "--speed", "2"),
        ("run", "--loop"),
        ("run", "--replay", "x", "--once", "--loop"),
        ("run", "--nonsense"),
        ("nonsense",),
        ("fuse",),
        ("fuse", "a", "b", "-o", "c"),
        ("fuse", "a", "-o", "c", "--output", "d"),
        ("fuse", "a", "-o", "a"),
        ("fuse", "a", "--method", "guess"),
        ("fuse", "a", "--regularization", "-1"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(words: tuple[str, ...]) -> None:
    result = lidarboost(*words)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
