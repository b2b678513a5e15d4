"""Recordings played, recorded and fetched with the client, and on the command line."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from commanding import Running, running
from replaying import playable
from test_commands import hasty_rig
from typer.testing import CliRunner

from service.cli import app
from service.errors import InvalidStateError, NotFoundError, OutOfRangeError, PermissionDeniedError
from service.wire.client import Client
from service.wire.recordings import Record

pytestmark = pytest.mark.slow


@pytest.fixture
def service(tmp_path: Path, endpoint: str) -> Iterator[Running]:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service:
        yield service


def test_the_client_plays_and_records(
    service: Running, endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.wire.recordings._PART", 1000)
    with Client(endpoint) as rig:
        with pytest.raises(InvalidStateError, match="no recording is loaded"):
            rig.replay.play()
        with pytest.raises(NotFoundError, match="cmd/record list shows all"):
            rig.replay.load("none.mcap")
        with pytest.raises(PermissionDeniedError, match="outside the recording folder"):
            rig.replay.load("../zenoh.json5")
        assert rig.replay.load("five.mcap", loop=True)["replay"]["frames"] == 20
        assert rig.replay.step()["report"]["burst"] == 10
        assert rig.replay.seek(1.2)["replay"]["burst"] == 3
        assert rig.replay.seek(frame=5)["replay"]["frame"] == 5
        with pytest.raises(OutOfRangeError, match="burst = 9: expected at most 4"):
            rig.replay.seek(burst=9)
        assert rig.replay.loop(False)["replay"]["loop"] is False
        assert rig.replay.speed(None)["replay"]["speed"] is None
        assert rig.replay.play()["replay"]["playing"] is True
        service.wait(lambda: rig.replay.get()["replay"]["ended"])
        assert rig.replay.pause()["replay"]["playing"] is False
        assert rig.replay.stop()["state"] == "idle"
        assert rig.record.start(maps=False)["recorder"]["recording"] is True
        assert rig.record.stop()["recorder"]["recording"] is False
        assert len(rig.record.list()["recordings"]) == 2
        rig.record.keep("five.mcap")
        told: list[tuple[int, int]] = []
        fetched = rig.record.fetch("five.mcap", tmp_path / "mine.mcap", progress=lambda *at: told.append(at))
        whole = (tmp_path / "kept" / "five.mcap").read_bytes()
        assert fetched.read_bytes() == whole
        assert told[-1] == (len(whole), len(whole))
        assert len(told) > 3
        with pytest.raises(NotFoundError):
            rig.record.fetch("none.mcap", tmp_path / "none.mcap")
        assert not list(tmp_path.glob("none*"))
        (tmp_path / "folder").mkdir()
        assert rig.record.fetch("five.mcap", str(tmp_path / "folder")) == tmp_path / "folder" / "five.mcap"
        assert rig.record.recover("five.mcap")["recovered"]["lost"] is None
    assert isinstance(rig.record, Record)


def run(endpoint: str, *arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [*arguments, "--endpoint", endpoint])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_line_plays(service: Running, endpoint: str) -> None:
    assert run(endpoint, "replay", "get") == (0, "idle: no recording is played\n", "")
    assert run(endpoint, "replay", "load", "five.mcap", "--speed", "0") == (
        0,
        "five.mcap: stands still; 0.0 of 1.9 s, frame 0 of 20, burst 0 of 5\n",
        "",
    )
    code, out, err = run(endpoint, "replay", "step", "2")
    assert (code, "burst 11: pose 4 of 4" in err or "burst 11: pose 4" in err) == (0, True)
    first, second = out.splitlines()
    assert first == "five.mcap: stands still; 0.8 of 1.9 s, frame 8 of 20, burst 2 of 5"
    assert second.startswith("burst 11: 4 of 4 frames; 12 × 8 pixels; nearest")
    assert json.loads(run(endpoint, "replay", "seek", "0.5", "--json")[1])["replay"]["frame"] == 4
    assert "frame 6 of 20" in run(endpoint, "replay", "seek", "--frame", "6")[1]
    assert run(endpoint, "replay", "seek")[0] == 2
    assert ", in a loop;" in run(endpoint, "replay", "loop")[1]
    assert "in a loop" not in run(endpoint, "replay", "loop", "--off")[1]
    assert ": stands still;" in run(endpoint, "replay", "speed", "2.5")[1]
    assert "playing, 2.5 times real time" in run(endpoint, "replay", "play")[1]
    assert ": stands still;" in run(endpoint, "replay", "pause")[1]
    code, out, err = run(endpoint, "replay", "load", "../zenoh.json5")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "is outside the recording folder; name a file in it" in err
    assert run(endpoint, "replay", "stop") == (0, "idle: no recording is played\n", "")
    service.wait_state("idle")


def test_the_command_line_records(
    service: Running, endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(endpoint, "record", "start", "--no-maps")
    assert (code, out.startswith("recording ")) == (0, True)
    code, out, _ = run(endpoint, "record", "list")
    assert code == 0
    newest, oldest = out.splitlines()
    assert newest.endswith("  written")
    assert oldest.startswith("five.mcap  0.0 MB  whole")
    assert run(endpoint, "record", "stop")[1].startswith("recorded ")
    assert run(endpoint, "record", "keep", "five.mcap")[0] == 0
    assert "five.mcap  0.0 MB  whole, kept" in run(endpoint, "record", "list")[1]
    assert run(endpoint, "record", "keep", "five.mcap", "--undo")[0] == 0
    code, out, _ = run(endpoint, "record", "fetch", "five.mcap", "--json")
    size = (tmp_path / "kept" / "five.mcap").stat().st_size
    assert json.loads(out) == {"file": "five.mcap", "size": size}
    code, _, err = run(endpoint, "record", "fetch", "five.mcap")
    assert (code, "exists already" in err) == (1, True)
    assert run(endpoint, "record", "fetch", "five.mcap", "--force") == (0, "five.mcap: 0.0 MB\n", "")
    whole = (tmp_path / "kept" / "five.mcap").read_bytes()
    (tmp_path / "kept" / "torn.mcap").write_bytes(whole[: len(whole) // 2])
    [listed] = [line for line in run(endpoint, "record", "list")[1].splitlines() if line.startswith("torn")]
    assert listed.endswith("MB  torn; to save what it holds: lidarboost record recover torn.mcap")
    code, out, _ = run(endpoint, "record", "recover", "torn.mcap")
    assert (code, out.startswith("torn.recovered.mcap: ")) == (3, True)
    assert "\nlost: " in out
    assert service.error is None
