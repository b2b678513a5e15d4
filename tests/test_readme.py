"""What the README says is what happens."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [
    *ROOT.glob("*.md"),
    *(
        path
        for folder in ("solver", "drivers", "service", "deploy")
        for path in (ROOT / folder).rglob("*.md")
    ),
]
SUBSCRIBERS = (ROOT / "service" / "messages" / "README.md").read_text(encoding="utf-8")


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page: Path) -> None:
    linked = re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8"))
    assert [name for name in linked if not (page.parent / name.replace("\\", "")).exists()] == []


def test_every_page_can_be_reached() -> None:
    """From the README, in one step or two."""
    seen = {ROOT / "README.md"}
    for _ in range(2):
        for page in list(seen):
            linked = re.findall(r"\]\(([^)#:]+\.md)\)", page.read_text(encoding="utf-8"))
            seen |= {(page.parent / name).resolve() for name in linked}
    assert {page.resolve() for page in PAGES} - seen - {ROOT / "CHANGELOG.md"} == set()


def example(kind: str, page: str = README) -> str:
    """The Python block of a page that is marked so."""
    (block,) = re.findall(rf"```{kind}\n(.*?)```", page, flags=re.S)
    return str(block)


def test_the_fusion_example_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(example("python"), "README.md", "exec"), {})
    assert "(576, 704) phasor" in capsys.readouterr().out


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a service on a port of its own."""
    folder = tmp_path_factory.mktemp("service")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    zenoh, config = folder / "zenoh.json5", folder / "rig.toml"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    config.write_text(f'[zenoh]\nconfig = "{zenoh}"\n\n[fusion]\nmethod = "nearest"\n')
    command = [sys.executable, "-m", "lidarboost", "run", config]
    command += ["--replay", "recordings/wedges.mcap", "--loop"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    service = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL)
    try:
        code = (
            f'import lidarboost\nwith lidarboost.Client("{endpoint}") as rig:\n'
            '    rig.latest("fused/depth", timeout=120)'
        )
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, check=True, timeout=150)
        yield endpoint
    finally:
        service.send_signal(signal.SIGTERM)
        service.wait(30)


@pytest.mark.parametrize(
    ("kind", "page"),
    [
        ("python zenoh", README),
        ("python command", README),
        ("python client", SUBSCRIBERS),
        ("python command", SUBSCRIBERS),
        ("python zenoh", SUBSCRIBERS),
    ],
)
def test_the_examples_with_a_running_service_run(kind: str, page: str, endpoint: str) -> None:
    """The endpoint that they have by default is replaced."""
    code = example(kind, page).replace("Client()", f'Client("{endpoint}")')
    code = code.replace("tcp/127.0.0.1:7447", endpoint)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120
    )
    assert "(576, 704) metres" in done.stdout, done.stderr


def test_the_table_of_commands_is_the_one_that_holds() -> None:
    from service.daemon.commands import command_table

    assert command_table() in SUBSCRIBERS


@pytest.mark.slow
def test_the_example_in_typescript_compiles(tmp_path: Path) -> None:
    """Where `TYPESCRIPT_MODULES` names a folder with the packages typescript and @eclipse-zenoh/zenoh-ts."""
    modules = Path(os.environ.get("TYPESCRIPT_MODULES", ""))
    compiler = modules / "typescript" / "bin" / "tsc"
    node = shutil.which("node")
    if node is None or not compiler.exists():
        pytest.skip("needs node, and TYPESCRIPT_MODULES with typescript and @eclipse-zenoh/zenoh-ts")
    (tmp_path / "node_modules").symlink_to(modules.resolve())
    (tmp_path / "example.mts").write_text(example("ts", SUBSCRIBERS))
    options = ["--strict", "--target", "es2022", "--module", "nodenext", "--skipLibCheck", "--noEmit"]
    done = subprocess.run(
        [node, compiler, *options, "example.mts"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
