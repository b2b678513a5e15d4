"""What the README says is what happens."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def commands(section: str) -> list[str]:
    """Lines of the shell blocks under a heading."""
    body = README.split(f"## {section}\n", 1)[1].split("\n## ", 1)[0]
    blocks = re.findall(r"```sh\n(.*?)```", body, flags=re.S)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


def test_there_are_exactly_two_commands_to_begin_with() -> None:
    run, test = commands("Two commands")
    assert "lidarboost run --replay recordings/wedges.mcap --once" in run
    assert test.endswith("pytest")


def test_ci_runs_the_test_command_word_for_word() -> None:
    assert commands("Two commands")[1] in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()


def test_files_that_are_named_exist() -> None:
    linked = re.findall(r"\]\(([^)#:]+)\)", README)
    assert linked
    assert [name for name in linked if not (ROOT / name).exists()] == []
