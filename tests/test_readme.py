"""What the README says is what happens."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

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


def example(kind: str) -> str:
    """The Python block of the README that is marked so."""
    (block,) = re.findall(rf"```{kind}\n(.*?)```", README, flags=re.S)
    return str(block)


def test_the_fusion_example_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(example("python"), "README.md", "exec"), {})
    assert "(576, 704) phasor" in capsys.readouterr().out


def test_the_client_example_runs(tmp_path: Path) -> None:
    """With a service on a port of its own, which the example is told by the environment's default."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    zenoh, config = tmp_path / "zenoh.json5", tmp_path / "rig.toml"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    config.write_text(f'[zenoh]\nconfig = "{zenoh}"\n\n[fusion]\nmethod = "nearest"\n')
    command = [
        sys.executable,
        "-m",
        "lidarboost",
        "run",
        config,
        "--replay",
        "recordings/wedges.mcap",
        "--loop",
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    service = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL)
    try:
        code = example("python client").replace("Client()", f'Client("{endpoint}")')
        code = code.replace('latest("fused/depth")', 'latest("fused/depth", timeout=60)')
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=90,
        )
    finally:
        service.send_signal(signal.SIGTERM)
        service.wait(30)
    assert "(576, 704) metres" in done.stdout, done.stderr
