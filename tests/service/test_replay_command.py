"""Recordings played on command, from another process with nothing but Zenoh and JSON."""

import os
import time
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from commanding import Running, running, stranger
from replaying import BURSTS, FRAMES, START, playable, record
from scripted import ScriptedCamera
from test_commands import hasty_rig

from drivers.errors import DeviceLostError, NotAvailableError
from drivers.fixed import FixedStage
from drivers.replay import ReplayCamera, ReplayOptions
from service.capture.player import Stepped
from service.capture.rig import Rig
from service.daemon.playing import Playing
from service.fusion.local import LocalExecutor
from service.messages.events import BurstCaptured, FrameCaptured, FusionFailed, MapFused, ReplayTold
from service.messages.map import FusedMap

pytestmark = pytest.mark.slow

ALL = BURSTS * FRAMES


def numbers(service: Running) -> list[int]:
    """Of the frames that were played so far."""
    return [event.frame.sequence for event in service.of(FrameCaptured)]


def bursts(service: Running) -> list[int]:
    """Ids of the bursts that were fused so far."""
    return [event.map.report.burst for event in service.of(MapFused)]


def test_a_recording_is_played_to_its_end_and_nothing_is_left_out(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint, fusion={"backlog": 1})
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        reply = far.ask("cmd/replay", action="load", file="five.mcap", speed=None)
        replay = reply["replay"]
        assert reply["state"] == "scanning"
        assert (replay["file"], replay["playing"], replay["frame"], replay["frames"], replay["bursts"]) == (
            "five.mcap",
            False,
            0,
            ALL,
            BURSTS,
        )
        assert replay["duration"] == pytest.approx((ALL - 1) / 10)
        assert replay["recorded"] == START
        assert numbers(service) == []
        assert far.ask("cmd/replay", action="play")["replay"]["playing"] is True
        service.wait(lambda: len(bursts(service)) == BURSTS)
        told = far.ask("cmd/replay", action="get")
        assert (told["replay"]["ended"], told["replay"]["playing"]) == (True, False)
        assert told["reason"] == "a replay stands still in five.mcap"
        assert numbers(service) == list(range(ALL))
        assert bursts(service) == [10, 11, 12, 13, 14]
        assert [len(event.burst.frames) for event in service.of(BurstCaptured)] == [FRAMES] * BURSTS
        assert service.daemon is not None
        assert service.daemon.fusing.backlog.dropped == 0
        assert far.ask("cmd/replay", action="step")["code"] == "INVALID_STATE"
        far.ask("cmd/replay", action="play")  # from the beginning
        service.wait(lambda: len(bursts(service)) == 2 * BURSTS)


def test_steps_and_seeks_go_by_bursts_and_by_frames(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap")
        reply = far.ask("cmd/replay", action="step")
        assert (reply["report"]["burst"], reply["replay"]["frame"]) == (10, FRAMES)
        reply = far.ask("cmd/replay", action="step", count=2)
        assert (reply["report"]["burst"], reply["replay"]["burst"]) == (12, 3)
        service.wait(lambda: bursts(service) == [10, 11, 12])
        assert far.ask("cmd/replay", action="seek", burst=1)["replay"]["frame"] == FRAMES
        assert far.ask("cmd/replay", action="seek", seconds=1.5)["replay"]["frame"] == 3 * FRAMES
        assert far.ask("cmd/replay", action="seek", frame=6)["replay"]["seconds"] == pytest.approx(0.6)
        before = len(numbers(service))
        reply = far.ask("cmd/replay", action="step", unit="frame")
        assert ("report" in reply, reply["replay"]["frame"]) == (False, 7)
        service.wait(lambda: numbers(service)[before:] == [6])
        reply = far.ask("cmd/replay", action="step")  # the rest of the burst, which lacks its beginning
        report = reply["report"]
        assert (report["burst"], report["frames"], report["missing"]) == (11, 2, 2)
        assert far.ask("cmd/replay", action="step", count=99)["replay"]["ended"] is True


def test_a_seek_while_it_plays_gives_up_the_burst_at_work(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap", play=True, speed=0.5)
        service.wait(lambda: len(numbers(service)) == 2)
        assert far.ask("cmd/replay", action="seek", burst=4)["replay"]["playing"] is True
        far.ask("cmd/replay", action="speed", speed=None)
        service.wait(lambda: bool(bursts(service)))
        assert bursts(service) == [14]
        assert numbers(service) == [0, 1, 16, 17, 18, 19]


def test_a_seek_begins_a_stream_anew(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        reply = far.ask("cmd/replay", action="load", file="five.mcap", mode="stream")
        assert reply["state"] == "streaming"
        assert far.ask("cmd/scan", action="once")["code"] == "INVALID_STATE"
        frames = [far.ask("cmd/replay", action="step")["report"]["frames"] for _ in range(3)]
        far.ask("cmd/replay", action="seek", seconds=1.0)
        frames += [far.ask("cmd/replay", action="step")["report"]["frames"] for _ in range(2)]
        assert frames == [1, 2, 3, 1, 2]
        service.wait(lambda: numbers(service) == [0, 1, 2, 10, 11])
        assert far.ask("cmd/replay", action="step", unit="burst")["replay"]["frame"] == 16
        far.ask("cmd/replay", action="speed", speed=None)
        far.ask("cmd/replay", action="play")
        service.wait(lambda: len(service.of(MapFused)) == 13)  # a map of every frame, however fast
        assert service.of(FusionFailed) == []


def test_it_goes_at_its_speed_pauses_and_begins_again(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap", loop=True, speed=2.0)
        began = time.monotonic()
        far.ask("cmd/replay", action="play")
        service.wait(lambda: len(numbers(service)) > 10)
        assert time.monotonic() - began > 0.45  # 1 s of it
        paused = far.ask("cmd/replay", action="pause")["replay"]
        assert paused["playing"] is False
        at = paused["frame"]
        assert far.ask("cmd/replay", action="get")["replay"]["frame"] == at
        far.ask("cmd/replay", action="speed", speed=1000.0)
        far.ask("cmd/replay", action="play")
        service.wait(lambda: far.ask("cmd/replay", action="get")["replay"]["round"] >= 2)
        times = [event.frame.timestamp for event in service.of(FrameCaptured)]
        assert times == sorted(set(times))
        assert far.ask("cmd/replay", action="loop", loop=False)["replay"]["loop"] is False
        service.wait(lambda: far.ask("cmd/replay", action="get")["replay"]["ended"])


def test_a_clock_set_in_the_middle_is_told_and_cut_short(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint)
    record(tmp_path / "kept" / "set.mcap", jump=56 * 365 * 86400 * 10**9)
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        replay = far.ask("cmd/replay", action="load", file="set.mcap", play=True, speed=20.0)["replay"]
        assert replay["gap_count"] == 1
        [gap] = replay["gaps"]
        assert gap == {"frame": 2 * FRAMES, "seconds": pytest.approx(56 * 365 * 86400, rel=1e-6)}
        assert replay["duration"] == pytest.approx(18 / 10 + 1)
        service.wait(lambda: len(bursts(service)) == BURSTS)


def test_its_state_is_told_often_while_it_plays(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        service.wait(lambda: bool(service.of(ReplayTold)))
        [nothing] = far.query("lidarboost/rig/replay/state")
        assert nothing["ok"]["file"] is None
        far.ask("cmd/replay", action="load", file="five.mcap", speed=0.1, play=True)
        service.wait(lambda: len(numbers(service)) >= 2)
        told = [event.replay for event in service.of(ReplayTold) if event.replay.playing]
        assert len(told) >= 5
        steps = [after.timestamp - before.timestamp for before, after in pairwise(told)]
        assert min(steps) >= 0
        [state] = far.query("lidarboost/rig/replay/state")
        assert (state["ok"]["file"], state["ok"]["playing"]) == ("five.mcap", True)


def test_a_method_that_is_changed_meanwhile_is_in_force_with_the_next_burst(
    tmp_path: Path, endpoint: str
) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()), stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap")
        assert far.ask("cmd/replay", action="step")["report"]["method"] == "nearest"
        assert "code" not in far.ask("cmd/fusion", action="set", method="bicubic")
        reply = far.ask("cmd/replay", action="step")
        assert (reply["report"]["method"], reply["report"]["burst"]) == ("bicubic", 11)


def test_after_a_replay_the_devices_scan_and_stream_again(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        assert service.daemon is not None
        daemon = service.daemon
        assert far.ask("cmd/scan", action="once")["report"]["frames"] == 4
        service.wait_state("idle")
        far.ask("cmd/replay", action="load", file="five.mcap", play=True, speed=None)
        assert daemon.camera is not None
        assert (daemon.camera.source, daemon.camera.serial) == ("replay", "7")
        for action in ("stop", "pause", "cancel", "resume"):
            refused = far.ask("cmd/scan", action=action)
            assert refused["code"] == "INVALID_STATE"
            assert "cmd/replay stop" in refused["message"]
        assert far.ask("cmd/stream", action="stop")["code"] == "INVALID_STATE"
        reply = far.ask("cmd/replay", action="stop")
        assert (reply["state"], reply["replay"]["file"]) == ("idle", None)
        assert daemon.camera.source == "device"
        assert far.ask("cmd/replay", action="stop")["state"] == "idle"
        assert far.ask("cmd/scan", action="once")["report"]["burst"] == 1
        service.wait_state("idle")
        assert far.ask("cmd/stream", action="start", window=2)["state"] == "streaming"
        maps = len(service.of(MapFused))
        service.wait(lambda: len(service.of(MapFused)) >= maps + 2)
        assert far.ask("cmd/replay", action="load", file="five.mcap")["state"] == "scanning"
        assert far.ask("cmd/scan", action="start")["state"] == "scanning"
        found = len(service.of(BurstCaptured))
        service.wait(lambda: len(service.of(BurstCaptured)) > found)
        assert daemon.camera.source == "device"
        far.ask("cmd/scan", action="stop")
        service.wait_state("idle")


def test_a_recording_that_vanishes_stands_still_and_says_so(tmp_path: Path, endpoint: str) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap")
        far.ask("cmd/replay", action="step")
        far.ask("cmd/replay", action="seek", frame=0)
        (tmp_path / "kept" / "five.mcap").unlink()
        refused = far.ask("cmd/replay", action="step")
        assert refused["code"] == "IO_FAILURE"
        assert "is it still there?" in far.ask("cmd/replay", action="get")["replay"]["error"]
        assert service.error is None
        assert far.ask("cmd/replay", action="stop")["state"] == "idle"


def test_what_cannot_be_done_is_refused_with_its_code(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint)
    (tmp_path / "kept" / "text.mcap").write_text("no recording")
    (tmp_path / "kept" / "away.mcap").symlink_to(record(tmp_path / "away.mcap"))
    os.mkfifo(tmp_path / "kept" / "pipe.mcap")
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        for action, arguments in (
            ("play", {}),
            ("pause", {}),
            ("step", {}),
            ("seek", {"seconds": 1.0}),
            ("speed", {"speed": 1.0}),
            ("loop", {"loop": True}),
        ):
            assert far.ask("cmd/replay", action=action, **arguments)["code"] == "INVALID_STATE"
        for file, code in (
            ("none.mcap", "NOT_FOUND"),
            ("pipe.mcap", "NOT_FOUND"),
            (".", "NOT_FOUND"),
            ("../away.mcap", "PERMISSION_DENIED"),
            ("away.mcap", "PERMISSION_DENIED"),
            ("/etc/passwd", "PERMISSION_DENIED"),
            ("text.mcap", "INVALID_ARGUMENT"),
            ("a\0b", "INVALID_ARGUMENT"),
            ("x" * 255 + ".mcap", "INVALID_ARGUMENT"),
        ):
            assert far.ask("cmd/replay", action="load", file=file)["code"] == code, file
        assert far.ask("cmd/replay", action="load", file="five.mcap", speed=0)["code"] == "OUT_OF_RANGE"
        assert service.daemon is not None
        assert service.daemon.states.state == "idle"
        far.ask("cmd/replay", action="load", file="five.mcap")
        for arguments, code in (
            ({"burst": 5}, "OUT_OF_RANGE"),
            ({"frame": 20}, "OUT_OF_RANGE"),
            ({"seconds": 2.0}, "OUT_OF_RANGE"),
            ({"frame": 2.5}, "INVALID_ARGUMENT"),
            ({}, "INVALID_ARGUMENT"),
            ({"frame": 1, "burst": 1}, "INVALID_ARGUMENT"),
        ):
            refused = far.ask("cmd/replay", action="seek", **arguments)
            assert refused["code"] == code, arguments
        assert far.ask("cmd/replay", action="get")["replay"]["frame"] == 0


def test_a_fusion_that_is_slow_holds_the_replay_back_and_commands_get_through(
    tmp_path: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = Event()
    done = LocalExecutor._done

    def slow(*arguments: Any) -> FusedMap:
        assert free.wait(60)
        return done(*arguments)

    monkeypatch.setattr(LocalExecutor, "_done", slow)
    settings = playable(tmp_path, endpoint, fusion={"backlog": 1})
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        for mode, taken, maps in (("scan", 2 * FRAMES, BURSTS), ("stream", 3, BURSTS + ALL)):
            free.clear()
            before = len(numbers(service))
            far.ask("cmd/replay", action="load", file="five.mcap", mode=mode, speed=None, play=True)
            service.wait(lambda before=before, taken=taken: len(numbers(service)) == before + taken)
            for action in ("pause", "play", "get"):
                assert far.ask("cmd/replay", action=action)["replay"]["frame"] == taken
            free.set()
            service.wait(lambda maps=maps: len(service.of(MapFused)) == maps)
            assert far.ask("cmd/replay", action="get")["replay"]["ended"] is True
        assert service.daemon is not None
        backlog = service.daemon.fusing.backlog
        assert (backlog.dropped, backlog.skipped) == (0, 0)


def test_it_plays_while_a_device_is_lost_which_is_opened_again_afterwards(
    tmp_path: Path, endpoint: str
) -> None:
    rig = hasty_rig(faults={1: DeviceLostError("unplugged")})
    camera = rig.camera
    assert isinstance(camera, ScriptedCamera)
    with running(playable(tmp_path, endpoint), rig) as service, stranger(endpoint) as far:
        camera.refusals = [NotAvailableError("no camera")] * 1000
        far.ask("cmd/scan", action="start")
        service.wait_state("recovering")
        assert far.ask("cmd/replay", action="load", file="five.mcap")["state"] == "scanning"
        assert far.ask("cmd/replay", action="step")["report"]["burst"] == 10
        assert far.ask("cmd/scan", action="start")["code"] == "UNAVAILABLE"
        assert far.ask("cmd/fusion", action="set", fill=3.0)["fusion"]["fill"] == 3.0
        far.ask("cmd/replay", action="stop")
        service.wait_state("recovering")
        camera.refusals = []
        service.wait_state("idle")
        assert far.ask("cmd/scan", action="once")["report"]["frames"] == 4


def replaying_rig(path: Path, **options: object) -> Rig:
    """What `--replay` makes."""
    return Rig(ReplayCamera(ReplayOptions(path=path, **options)), FixedStage())  # type: ignore[arg-type]


def test_a_service_that_began_with_a_recording_is_commanded_as_well(tmp_path: Path, endpoint: str) -> None:
    settings = playable(tmp_path, endpoint, start="scan", recording={"enabled": True})
    rig = replaying_rig(tmp_path / "kept" / "five.mcap", speed=0.5)
    with running(settings, rig, "scanning") as service, stranger(endpoint) as far:
        service.wait(lambda: bool(numbers(service)))
        replay = far.ask("cmd/replay", action="pause")["replay"]
        assert (replay["file"], replay["speed"]) == ("five.mcap", 0.5)
        far.ask("cmd/replay", action="seek", burst=2)
        assert far.ask("cmd/scan", action="once")["report"]["burst"] == 12
        far.ask("cmd/replay", action="speed", speed=None)
        far.ask("cmd/replay", action="play")
        service.wait(lambda: bursts(service) == [12, 13, 14])
        assert far.ask("cmd/replay", action="get")["replay"]["ended"] is True
        assert far.ask("cmd/scan", action="once")["code"] == "INVALID_STATE"
        assert far.ask("cmd/replay", action="stop")["state"] == "idle"
        assert service.thread.is_alive()
    assert not list((tmp_path / "kept").glob("2*"))  # a replay is not recorded unless asked


@pytest.mark.parametrize(("start", "maps"), [("scan", BURSTS), ("stream", ALL)])
def test_a_service_that_began_with_a_recording_ends_with_it(
    tmp_path: Path, endpoint: str, start: str, maps: int
) -> None:
    settings = playable(tmp_path, endpoint, start=start, fusion={"backlog": 1})
    service = Running(settings, replaying_rig(tmp_path / "kept" / "five.mcap"))
    service.thread.start()
    service.thread.join(60)
    assert service.error is None
    assert service.summary is not None
    assert (service.summary.maps, service.summary.frames, service.summary.lost) == (maps, ALL, ())


def test_a_step_right_behind_a_seek_is_not_given_up_with_what_was_before(
    tmp_path: Path, endpoint: str
) -> None:
    with running(playable(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/replay", action="load", file="five.mcap")
        assert service.daemon is not None
        mode = service.daemon.mode
        assert isinstance(mode, Playing)

        def seek_and_step() -> Stepped:
            mode.change(lambda player: player.seek(FRAMES))
            return mode.step(FRAMES)

        report = service.daemon.control.inbox.submit(seek_and_step, "pose").result(30).result(30)
        assert report is not None
        assert report.burst == 11
