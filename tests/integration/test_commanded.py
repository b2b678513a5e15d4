"""A rig run from another process with nothing but Zenoh and JSON, from idle to its end."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "service"))

from commanding import Stranger, stranger  # noqa: E402

pytestmark = pytest.mark.faults

CONFIG = """
start = "idle"
[camera]
backend = "simulated"
[stage]
backend = "simulated"
[fusion]
method = "nearest"
frames = 5
[recording]
enabled = true
directory = "{folder}/recordings"
[zenoh]
config = "{folder}/zenoh.json5"
"""


@contextmanager
def service(folder: Path, endpoint: str) -> Iterator[subprocess.Popen[str]]:
    """`lidarboost run` with a simulated rig, idle."""
    (folder / "zenoh.json5").write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    (folder / "rig.toml").write_text(CONFIG.format(folder=folder))
    process = subprocess.Popen(
        [sys.executable, "-m", "lidarboost", "run", str(folder / "rig.toml")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=20)


def wait(far: Stranger, state: str) -> dict[str, object]:
    """The manifest, once the service is in a state."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        for reply in far.query("lidarboost/rig/manifest", timeout=2):
            if reply["ok"]["state"] == state:
                manifest: dict[str, object] = reply["ok"]
                return manifest
        time.sleep(0.02)
    raise AssertionError(f"not {state} in time")


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """SIGTERM; its status and what it said. It must end within 5 s, here with room for a busy machine."""
    process.send_signal(signal.SIGTERM)
    said, _ = process.communicate(timeout=10)
    return process.returncode, said


@pytest.fixture
def endpoint() -> str:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def test_a_rig_is_run_from_idle_to_its_end(tmp_path: Path, endpoint: str) -> None:
    from drivers.recording import open_recording

    with service(tmp_path, endpoint) as process, stranger(endpoint) as far:
        manifest = wait(far, "idle")
        assert manifest["source"] == "simulation"
        check = far.ask("cmd/scan", action="check")["check"]
        assert check["poses"] == 5
        assert check["exposure"]["noise"] > 0
        far.send("lidarboost/rig/cmd/scan", payload=json.dumps({"action": "once", "map": True}), timeout=60)
        first, *messages = far.replies()
        assert first["ok"]["report"]["method"] == "nearest"
        assert {"fused/depth", "fused/report"} <= {message["attachment"] for message in messages}
        assert far.ask("cmd/fusion", action="set", method="bicubic")["fusion"]["method"] == "bicubic"
        assert far.ask("cmd/scan", action="once")["report"]["method"] == "bicubic"
        assert far.ask("cmd/stream", action="start", window=3)["state"] == "streaming"
        assert far.ask("cmd/stream", action="stop")
        wait(far, "idle")
        assert far.ask("cmd/scan", action="start")["state"] == "scanning"
        assert far.ask("cmd/scan", action="pause")["paused"]
        assert far.ask("cmd/settings", action="set", integration_time=0.01)["code"] == "INVALID_STATE"
        assert not far.ask("cmd/scan", action="resume")["paused"]
        assert far.ask("cmd/settings", action="set", integration_time=0.01)["state"] == "scanning"
        assert far.ask("cmd/plan", action="set", pan=500)["code"] == "OUT_OF_RANGE"
        assert far.ask("cmd/scan", action="cancel")
        wait(far, "idle")
        name = Path(far.ask("cmd/record", action="stop")["recorder"]["file"]).name
        replay = far.ask("cmd/replay", action="load", file=name)["replay"]
        assert (replay["playing"], replay["bursts"] >= 2) == (False, True)
        assert wait(far, "scanning")["source"] == "replay"
        assert far.ask("cmd/replay", action="step")["report"]["burst"] == 0
        assert far.ask("cmd/replay", action="seek", burst=1)["replay"]["burst"] == 1
        reply = far.ask("cmd/replay", action="step")
        assert reply.get("report", reply)["frames"] == 5
        assert far.ask("cmd/replay", action="stop")["state"] == "idle"
        assert wait(far, "idle")["source"] == "simulation"
        status, said = end(process)
    assert status == 0, said
    assert "cmd/fusion {'method': 'bicubic', 'action': 'set'} by somebody" in said
    (path,) = (tmp_path / "recordings").glob("*.mcap")
    found = open_recording(path).contents.metadata
    records = [record.metadata for record in found if record.name == "command"]
    told = [(record["command"], json.loads(record["arguments"])["action"]) for record in records]
    assert ("cmd/fusion", "set") in told
    assert {record["who"] for record in records} == {"somebody"}


@pytest.mark.parametrize("state", ["idle", "scanning", "paused", "streaming", "replaying"])
def test_a_signal_ends_it_in_every_state(tmp_path: Path, endpoint: str, state: str) -> None:
    with service(tmp_path, endpoint) as process, stranger(endpoint) as far:
        wait(far, "idle")
        if state in ("scanning", "paused"):
            far.ask("cmd/scan", action="start")
        if state == "paused":
            far.ask("cmd/scan", action="pause")
        if state == "streaming":
            far.ask("cmd/stream", action="start")
        if state == "replaying":
            far.ask("cmd/scan", action="once")
            name = Path(far.ask("cmd/record", action="stop")["recorder"]["file"]).name
            far.ask("cmd/replay", action="load", file=name, play=True, loop=True)
        began = time.monotonic()
        status, said = end(process)
        assert time.monotonic() - began < 7
    assert status == 0, said
