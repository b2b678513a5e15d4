"""Every block of code and every command in the documentation is run, or compared with what it describes."""

import inspect
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from test_readme import PAGES, ROOT
from typer.testing import CliRunner

from service.cli import app

PROGRAM = typer.main.get_command(app)

NEWCOMER = "tests/service/test_contributing.py: test_a_newcomer_adds_a_camera_a_stage_and_a_sink"

RUN_BY = {
    "README.md": {
        "sh": "tests/test_readme.py: test_there_are_exactly_two_commands_to_begin_with",
        "python": "tests/test_readme.py: test_the_fusion_example_runs",
        "python command": "tests/test_readme.py: test_the_examples_with_a_running_service_run",
        "python zenoh": "tests/test_readme.py: test_the_examples_with_a_running_service_run",
    },
    "CONTRIBUTING.md": {
        "python sink": NEWCOMER,
        "toml package": NEWCOMER,
        "python camera": NEWCOMER,
        "python stage": NEWCOMER,
        "python method": "tests/service/test_contributing.py: test_a_newcomer_adds_a_method",
        "diff": "tests/service/test_contributing.py: test_a_newcomer_adds_a_topic",
        "toml": "tests/test_documentation.py: test_configuration_that_is_shown_is_one",
    },
    "deploy/README.md": {
        "sh": "tests/test_documentation.py: test_shell_lines_of_the_operator",
        "toml": "tests/test_documentation.py: test_configuration_that_is_shown_is_one",
    },
    "service/messages/README.md": {
        "python client": "tests/test_readme.py: test_the_examples_with_a_running_service_run",
        "python command": "tests/test_readme.py: test_the_examples_with_a_running_service_run",
        "python zenoh": "tests/test_readme.py: test_the_examples_with_a_running_service_run",
        "ts": "tests/test_readme.py: test_the_example_in_typescript_compiles",
    },
    "service/daemon/commands/README.md": {
        "python": "tests/service/test_commands.py: test_a_newcomer_adds_a_command_in_one_file",
    },
    "solver/README.md": {
        "python": "tests/test_documentation.py: test_a_method_has_the_signature_that_is_shown"
    },
}
"""By page and kind of block: the test that runs it. Plain blocks are drawings."""


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path) -> list[tuple[str, str]]:
    """Kind and content of each fenced block that has a kind."""
    found = re.findall(r"^```([^\n]*)\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    return [(kind, content) for kind, content in found if kind]


def block(page: str, kind: str) -> str:
    return "\n".join(content for found, content in blocks(ROOT / page) if found == kind)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_has_a_test_that_runs_it(page: Path) -> None:
    told = RUN_BY.get(name(page), {})
    assert {kind for kind, _ in blocks(page)} == set(told)
    for place in told.values():
        file, _, test = place.partition(": ")
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8")


def mentioned(page: Path) -> Iterator[str]:
    """Commands of ours in shell blocks and in code within lines."""
    text = page.read_text(encoding="utf-8")
    for line in "\n".join(content for kind, content in blocks(page) if kind == "sh").splitlines():
        yield from re.findall(r"\blidarboost [a-z][^#&]*", line) if "docker" not in line else ()
    plain = re.sub(r"^```.*?^```$", "", text, flags=re.S | re.M)
    yield from re.findall(r"`(?:[A-Z_]+=\S+ )*(lidarboost [a-z][^`]*)`", plain)


def helped(command: Any) -> Iterator[str]:
    """The examples in a command's help, and in those below it."""
    text = (command.help or "").replace("\\\n", " ")
    yield from re.findall(r"^\s+(?:[A-Z_]+=\S+\s+)*(lidarboost [a-z].*)$", text, flags=re.M)
    for below in below_of(command).values():
        yield from helped(below)


def below_of(command: Any) -> dict[str, Any]:
    """The commands of a group by name; none where it is no group."""
    if not hasattr(command, "list_commands"):
        return {}
    return {one: command.get_command(None, one) for one in command.list_commands(None)}


def unknown(command: str) -> list[str]:
    """What of a command there is not: of its words up to the first that is no name, and its options."""
    command = command.replace("\\|", "|").replace("…", "").replace("[", " ").replace("]", " ")
    _, *words = shlex.split(command, comments=True)
    reached: list[Any] = [PROGRAM]
    while words and (there := below_of(reached[0])):
        choices = words.pop(0).split("|")
        absent = [one for one in choices if one not in there]
        if absent:
            return absent
        reached = [there[one] for one in choices]
    options = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    known = [{*opt.opts, *opt.secondary_opts, "--help"} for one in reached for opt in one.params]
    return [option for option in options if not any(option in names for names in known)]


EVERY = [(name(page), command) for page in PAGES for command in mentioned(page)]
EVERY += [("help", command) for command in helped(PROGRAM)]


def test_there_are_commands_to_look_at() -> None:
    assert len(EVERY) > 60


@pytest.mark.parametrize(("place", "command"), EVERY)
def test_commands_and_options_that_are_named_exist(place: str, command: str) -> None:
    assert unknown(" ".join(command.split())) == [], place


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_scripts_and_extras_that_are_named_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    scripts = re.findall(r"`(?:[A-Z_]+=\S+ )*python ([\w/.-]+)", text)
    assert [script for script in scripts if "/" in script and not (ROOT / script).exists()] == []
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    extras = {one for names in re.findall(r"lidarboost\[([a-z0-9,]+)\]", text) for one in names.split(",")}
    assert extras <= set(known)


def test_what_does_not_exist_is_noticed() -> None:
    assert unknown("lidarboost rnu rig.toml") == ["rnu"]
    assert unknown("lidarboost fuse a.mcap --methdo area") == ["--methdo"]
    assert unknown("lidarboost record start|stpo") == ["stpo"]


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "deploy/README.md"])
def test_configuration_that_is_shown_is_one(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(block(page, "toml"))
    (tmp_path / "depth_log.py").write_text(block("CONTRIBUTING.md", "python sink"))
    monkeypatch.syspath_prepend(tmp_path)
    done = CliRunner().invoke(app, ["config", "check", str(file)])
    assert done.exit_code == 0, done.output


def test_a_method_has_the_signature_that_is_shown() -> None:
    from solver.methods import area
    from solver.preparation.problem import Problem, Solution
    from solver.result import Progress

    scope = {"Problem": Problem, "Solution": Solution, "Progress": Progress}
    exec(block("solver/README.md", "python"), scope)
    assert inspect.signature(scope["solve"]) == inspect.signature(area.solve)  # type: ignore[arg-type]


def test_shell_lines_of_the_operator(tmp_path: Path) -> None:
    """What needs root, containers or devices is looked at: that what it names is there."""
    lines = [line.partition("#")[0].strip() for line in block("deploy/README.md", "sh").splitlines()]
    left = []
    for line in filter(None, lines):
        match shlex.split(line):
            case ["lidarboost", *words]:
                done = CliRunner().invoke(app, words)
                assert done.exit_code in (0, 1), done.output  # 1: the doctor found something
                assert done.exception is None or isinstance(done.exception, SystemExit)
            case ["python", script, *words]:
                command = [sys.executable, str(ROOT / script), *words]
                subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
                assert {"authority.pem", "router.pem", "rig.key", "anna.pem"} <= {
                    path.name for path in (tmp_path / words[0]).iterdir()
                }
            case ["sudo", "cp", unit, *_]:
                assert "[Service]" in (ROOT / unit).read_text()
            case ["sudo", "systemctl", "reload", _]:
                assert "ExecReload=" in (ROOT / "deploy/lidarboost.service").read_text()
            case ["docker", *words]:
                assert (ROOT / words[words.index("-f") + 1]).is_file()
            case ["pip", "install", package]:
                assert package in (ROOT / "pyproject.toml").read_text()
            case _:
                left.append(line)
    assert left == []


@pytest.mark.slow
def test_the_first_scan_goes_as_the_operator_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`config check`, `config schema`, `config presets`, `run rig.toml --once --output out`."""
    shutil.copy(ROOT / "deploy" / "rigs" / "simulated.toml", tmp_path / "rig.toml")
    for words in (["config", "check", "rig.toml"], ["config", "schema"], ["config", "presets"]):
        assert ran(tmp_path, *words).returncode == 0
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    file = tmp_path / "zenoh.json5"
    file.write_text(f'{{ listen: {{ endpoints: ["tcp/127.0.0.1:{port}"] }} }}')
    monkeypatch.setenv("LIDARBOOST_ZENOH__CONFIG", str(file))
    done = ran(tmp_path, "run", "rig.toml", "--once", "--output", "out")
    assert done.returncode == 0, done.stderr
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".mcap", ".png"}


@pytest.mark.slow
def test_a_bag_is_imported_and_a_folder_fused_as_it_is_told(tmp_path: Path) -> None:
    """`import bag/ --kind depth --burst 15 -o bag.mcap`, `fuse FOLDER --output maps`, `info`."""
    pytest.importorskip("rosbags", reason="needs rosbags")
    sys.path.append(str(ROOT / "tests" / "drivers"))
    from made_bags import depth_bag

    depth_bag(count=15).save(tmp_path / "bag")
    done = ran(tmp_path, "import", "bag/", "--kind", "depth", "--burst", "15", "-o", "bag.mcap")
    assert done.returncode == 0, done.stderr
    (tmp_path / "FOLDER").mkdir()
    shutil.move(tmp_path / "bag.mcap", tmp_path / "FOLDER")
    done = ran(tmp_path, "fuse", "FOLDER", "--output", "maps", "--method", "nearest")
    assert done.returncode == 0, done.stderr
    (result,) = (tmp_path / "maps").glob("*-fused.mcap")
    assert ran(tmp_path, "info", str(result)).returncode == 0


def ran(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); "]
    command[-1] += "from service.entry import main; main()"
    return subprocess.run([*command, *words], cwd=folder, capture_output=True, text=True, timeout=170)
