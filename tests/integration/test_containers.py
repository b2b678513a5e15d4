"""The container files: what they name is there, and their commands do what they shall, here without one."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from daemons import free_port

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
CLI = "from service.entry import main; main()"
COMPOSE: dict[str, Any] = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))
INSTRUCTIONS = [
    (line.partition(" ")[0], line.partition(" ")[2])
    for line in re.sub(r"\\\n", " ", (DEPLOY / "Containerfile").read_text(encoding="utf-8")).splitlines()
    if line and not line.startswith("#") and not line.startswith(" ")
]


def values(instruction: str) -> list[str]:
    return [value for name, value in INSTRUCTIONS if name == instruction]


def test_all_that_is_copied_into_the_image_is_there() -> None:
    copied = [value.split() for value in values("COPY") if value.startswith("--from=build /source")]
    assert copied
    for _, source, _ in copied:
        assert (ROOT / source.removeprefix("/source/")).exists(), source
    assert values("FROM")[-1].startswith("docker.io/library/python:3.11")
    assert values("USER") == ["lidarboost"], "not as root"
    assert values("STOPSIGNAL") == ["SIGTERM"]


def test_every_service_has_room_for_shared_memory_and_nobody_outside_reaches_it() -> None:
    assert set(COMPOSE["services"]) == {"router", "rig", "subscriber"}
    for service in COMPOSE["services"].values():
        assert service["shm_size"] == "256m"
        assert service["read_only"] is True
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", ()))
        for volume in service.get("volumes", ()):
            assert volume.partition(":")[0] in COMPOSE["volumes"]
        for other in service.get("depends_on", ()):
            assert other in COMPOSE["services"]
    assert (DEPLOY / COMPOSE["services"]["rig"]["build"]["context"] / "pyproject.toml").exists()


class Here:
    """The image's files with paths and addresses of this machine."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.router_at, self.port = folder, f"tcp/127.0.0.1:{free_port()}", free_port()
        changes = {
            "/etc/lidarboost": str(folder),
            "tcp/router:7447": self.router_at,
            "tcp/0.0.0.0:7447": self.router_at,
            "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{free_port()}",
            "enabled = true": f"enabled = true\nport = {self.port}",
            "127.0.0.1:9464": f"127.0.0.1:{self.port}",
        }
        self._changes = changes
        for file in (DEPLOY / "container").iterdir():
            if file.is_file():
                (folder / file.name).write_text(self.text(file.read_text(encoding="utf-8")), encoding="utf-8")

    def text(self, text: str) -> str:
        for old, new in self._changes.items():
            text = text.replace(old, new)
        return text

    def command(self, words: list[str]) -> list[str]:
        program, *rest = [self.text(word) for word in words]
        return [sys.executable, *(["-c", CLI] if program == "lidarboost" else []), *rest]

    @contextmanager
    def service(self, name: str) -> Iterator["subprocess.Popen[str]"]:
        told = COMPOSE["services"][name]
        words = [*told.get("entrypoint", yaml.safe_load(values("ENTRYPOINT")[0])), *told["command"]]
        process = subprocess.Popen(self.command(words), cwd=ROOT, stdout=subprocess.PIPE, text=True)
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    def health(self) -> int:
        words = yaml.safe_load(re.search(r"CMD (\[.*\])", values("HEALTHCHECK")[0])[1])  # type: ignore[index]
        return subprocess.run(self.command(words), capture_output=True, timeout=60, check=False).returncode


@pytest.mark.slow
def test_the_three_services_work_together(tmp_path: Path) -> None:
    here = Here(tmp_path)
    with ExitStack() as stack:
        router = stack.enter_context(here.service("router"))
        assert router.stdout is not None
        assert router.stdout.readline().startswith("routing as")
        assert here.health() != 0, "nothing runs yet"
        rig = stack.enter_context(here.service("rig"))
        deadline = time.monotonic() + 120
        while here.health() != 0:
            assert time.monotonic() < deadline
            assert rig.poll() is None
        subscriber = stack.enter_context(here.service("subscriber"))
        assert subscriber.stdout is not None
        assert "burst" in subscriber.stdout.readline()
        for process in (rig, router):
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0


def test_the_ignored_files_do_not_hide_what_is_copied() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert not {"deploy", "recordings", "service", "solver", "drivers"} & {
        line.strip("/*") for line in ignored
    }
    assert shlex.split(values("ENV")[0])[0].startswith("PATH=/opt/lidarboost/bin")
    assert os.access(DEPLOY / "container" / "health.py", os.R_OK)
