"""Recordings begun, listed, kept, fetched and saved from another process with nothing but Zenoh and JSON."""

import errno
import json
import os
from pathlib import Path

import pytest
from commanding import Running, running, stranger
from replaying import playable, record
from test_commands import hasty_rig

import drivers.recording.output as output
from drivers.recording import Recording
from service.messages.events import MapFused


def scan(service: Running, far: object) -> None:
    """One burst, and all is at rest again."""
    far.ask("cmd/scan", action="once")  # type: ignore[attr-defined]
    service.wait_state("idle")


def test_a_recording_is_begun_and_ended_and_holds_what_was_asked_for(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint, recording={"preroll": 60.0})
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        scan(service, far)
        recorder = far.ask("cmd/record", action="start", maps=False)["recorder"]
        assert recorder["recording"] is True
        assert far.ask("cmd/record", action="start", maps=False)["recorder"]["file"] == recorder["file"]
        assert far.ask("cmd/record", action="start", maps=True)["code"] == "INVALID_STATE"
        far.ask("cmd/plan", action="set", span=0.5)
        scan(service, far)
        name = Path(recorder["file"]).name
        [written] = [
            one for one in far.ask("cmd/record", action="list")["recordings"] if one["state"] == "written"
        ]
        assert written["file"] == f"{name}.active"
        for action in ("fetch", "recover"):
            assert far.ask("cmd/record", action=action, file=f"{name}.active")["code"] == "INVALID_STATE"
        assert far.ask("cmd/record", action="stop")["recorder"]["recording"] is False
        assert far.ask("cmd/record", action="stop")["recorder"]["recording"] is False
        scan(service, far)
    recording = Recording(tmp_path / "kept" / name)
    assert recording.frame_count == 8  # half of them from before it was asked for
    assert recording.damage is None
    assert not [topic for topic in recording.topics if topic.startswith("fused/")]
    assert recording.metadata["source"] == "device"
    told = [one.metadata for one in recording.contents.metadata if one.name == "command"]
    assert [one["command"] for one in told] == ["cmd/record", "cmd/record", "cmd/plan", "cmd/scan"]
    assert json.loads(told[2]["arguments"]) == {"action": "set", "span": 0.5}


def test_a_replay_is_recorded_only_if_asked_for(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint, recording={"enabled": True})
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        scan(service, far)
        far.ask("cmd/replay", action="load", file="five.mcap")
        far.ask("cmd/replay", action="step", count=2)
        refused = far.ask("cmd/record", action="start")
        assert (refused["code"], '{"replays": true}' in refused["message"]) == ("INVALID_STATE", True)
        far.ask("cmd/replay", action="stop")
        scan(service, far)
        far.ask("cmd/record", action="stop")
        far.ask("cmd/replay", action="load", file="five.mcap")
        far.ask("cmd/record", action="start", replays=True)
        far.ask("cmd/replay", action="step", count=3)
        far.ask("cmd/record", action="stop")
    paths = sorted((tmp_path / "kept").glob("2*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    files = [Recording(path) for path in paths]
    assert [(file.metadata["source"], file.frame_count) for file in files] == [
        ("device", 4),
        ("device", 4),
        ("replay", 12),
    ]
    assert files[2].metadata["camera_serial"] == "7"
    assert files[2].calibration == Recording(tmp_path / "kept" / "five.mcap").calibration
    assert len(list(files[2].messages(["fused/report"]))) == 3


def test_the_folder_is_listed_kept_and_fetched_in_parts(tmp_path: Path, endpoint: str) -> None:
    path = tmp_path / "kept" / "five.mcap"
    with running(playable(tmp_path, endpoint), hasty_rig()), stranger(endpoint) as far:
        os.utime(record(tmp_path / "kept" / "old.mcap"), (1, 1))
        (tmp_path / "kept" / "notes.txt").write_text("no recording")
        reply = far.ask("cmd/record", action="list")
        assert [(one["file"], one["state"], one["kept"]) for one in reply["recordings"]] == [
            ("five.mcap", "whole", False),
            ("old.mcap", "whole", False),
        ]
        assert reply["recordings"][0]["size"] == path.stat().st_size
        reply = far.ask("cmd/record", action="list", count=1)
        assert (len(reply["recordings"]), reply["more"]) == (1, 1)
        far.ask("cmd/record", action="keep", file="old.mcap")
        far.ask("cmd/record", action="keep")
        assert all(one["kept"] for one in far.ask("cmd/record", action="list")["recordings"])
        far.ask("cmd/record", action="keep", file="old.mcap", keep=False)
        assert [one["kept"] for one in far.ask("cmd/record", action="list")["recordings"]] == [True, False]
        request = '{"action": "fetch", "file": "five.mcap", "offset": 10, "size": 100}'
        first, octets = far.query("lidarboost/rig/cmd/record", payload=request)
        assert first["ok"]["part"] == {
            "file": "five.mcap",
            "offset": 10,
            "size": 100,
            "total": path.stat().st_size,
        }
        assert (octets["ok"], octets["encoding"], octets["attachment"]) == (
            100,
            "application/octet-stream",
            "five.mcap",
        )
        for arguments, code in (
            ({"file": "../away.mcap"}, "PERMISSION_DENIED"),
            ({"file": "/etc/passwd"}, "PERMISSION_DENIED"),
            ({"file": "none.mcap"}, "NOT_FOUND"),
            ({"file": "five.mcap", "size": 4_000_001}, "OUT_OF_RANGE"),
            ({"file": "five.mcap", "offset": 10**9}, "OUT_OF_RANGE"),
            ({"file": "five.mcap", "offset": -1}, "OUT_OF_RANGE"),
            ({}, "INVALID_ARGUMENT"),
        ):
            assert far.ask("cmd/record", action="fetch", **arguments)["code"] == code, arguments


def test_a_torn_recording_is_saved(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint)
    whole = (tmp_path / "kept" / "five.mcap").read_bytes()
    torn = tmp_path / "kept" / "20260101T000000Z.mcap.active"
    torn.write_bytes(whole[: len(whole) // 2])
    (tmp_path / "kept" / "text.mcap").write_text("no recording")
    with running(settings, hasty_rig()), stranger(endpoint) as far:
        states = {one["file"]: one["state"] for one in far.ask("cmd/record", action="list")["recordings"]}
        assert states[torn.name] == "torn"
        reply = far.ask("cmd/record", action="recover", file=torn.name)
        made = reply["recovered"]
        assert made["file"] == "20260101T000000Z.recovered.mcap"
        assert Recording(tmp_path / "kept" / made["file"]).damage is None
        assert made["lost"]
        assert far.ask("cmd/record", action="recover", file=torn.name)["code"] == "INVALID_STATE"
        assert far.ask("cmd/record", action="recover", file="text.mcap")["code"] == "INVALID_ARGUMENT"
        assert far.ask("cmd/record", action="recover", file="../x.mcap")["code"] == "PERMISSION_DENIED"


def test_a_recording_that_was_cut_is_listed_as_torn_whatever_it_is_called(
    tmp_path: Path, endpoint: str
) -> None:
    settings = playable(tmp_path, endpoint)
    kept = tmp_path / "kept"
    whole = (kept / "five.mcap").read_bytes()
    for name, content in (
        ("cut.mcap", whole[: len(whole) // 2]),
        ("x.torn.mcap", whole[:-1]),
        ("0.mcap", b""),
    ):
        (kept / name).write_bytes(content)
    with running(settings, hasty_rig()), stranger(endpoint) as far:
        states = {one["file"]: one["state"] for one in far.ask("cmd/record", action="list")["recordings"]}
        assert states == {"five.mcap": "whole", "cut.mcap": "torn", "x.torn.mcap": "torn", "0.mcap": "torn"}
        made = far.ask("cmd/record", action="recover", file="cut.mcap")["recovered"]["file"]
        states = {one["file"]: one["state"] for one in far.ask("cmd/record", action="list")["recordings"]}
        assert (states[made], states["cut.mcap"]) == ("whole", "torn")


def test_a_disk_that_is_full_is_said_at_once_and_nothing_else_notices(
    tmp_path: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path) -> object:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        with monkeypatch.context() as patch:
            patch.setattr(output, "open_unbuffered", full)
            refused = far.ask("cmd/record", action="start")
        assert refused["code"] == "IO_FAILURE"
        assert "the disk is full" in refused["message"]
        scan(service, far)
        assert len(service.of(MapFused)) == 1
        assert far.ask("cmd/record", action="start")["recorder"]["recording"] is True
