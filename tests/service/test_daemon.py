"""The daemon in one process: scan loop, faults, outputs, and nothing half-written after an error."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from scripted import ScriptedCamera, ScriptedStage, frame

from drivers import DeviceLostError, Frame, LimitError
from drivers.clock import VirtualClock
from drivers.messages import decode_image
from drivers.recording import open_recording
from service.capture.rig import Rig
from service.config import Configuration
from service.config_file import load
from service.daemon import Daemon, Watch
from service.errors import MotionError, PlanError, ServiceError, SessionError
from service.fusion.summary import BurstSummary
from service.health.systemd import WATCHDOG
from service.wire.session import open_session

FUSION = {"method": "nearest", "upsampling": 2, "register_poses": False, "frames": 4}


@pytest.fixture
def configure(tmp_path: Path, endpoint: str) -> Callable[..., Configuration]:
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))

    def configure(**sections: dict[str, object]) -> Configuration:
        sections["fusion"] = {**FUSION, **sections.get("fusion", {})}
        return load(None, {"zenoh": {"config": str(zenoh)}, **sections})

    return configure


class HastyClock(VirtualClock):
    """A hundred times as fast as the real one."""

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        time.sleep(max(0.0, seconds) / 100)


def rig(**script: object) -> Rig:
    clock = HastyClock(1_700_000_000_000_000_000)
    return Rig(ScriptedCamera(clock, **script), ScriptedStage(clock), clock)  # type: ignore[arg-type]


class StopAfter(Watch):
    """Stops the daemon after some maps."""

    def __init__(self, maps: int) -> None:
        self.maps, self.seen = maps, 0

    def started(self, daemon: Daemon) -> None:
        self.daemon = daemon

    def fused(self, burst: BurstSummary) -> None:  # noqa: ARG002
        self.seen += 1
        if self.seen >= self.maps:
            self.daemon.stop.set()


def test_one_burst_of_the_plan_is_captured_fused_and_written(configure, tmp_path: Path) -> None:
    output = tmp_path / "out" / "deep"
    summary = Daemon(configure(), rig(), output=output, once=True).run()
    assert (summary.frames, summary.bursts, summary.maps, summary.lost) == (4, 1, 1, ())
    assert summary.fused[0].report.used == (0, 1, 2, 3)
    assert sorted(path.name for path in output.iterdir()) == ["burst-0000.png", "fused.mcap"]
    assert {Path(name).name for name in summary.files} == {"burst-0000.png", "fused.mcap"}
    assert (output / "burst-0000.png").read_bytes().startswith(b"\x89PNG")

    recording = open_recording(output / "fused.mcap")
    assert recording.damage is None
    assert recording.frame_count == 4
    assert recording.metadata["camera_model"] == "scripted"
    assert 'method = "nearest"' in (recording.configuration or "")
    messages = {message.topic: message for message, _ in recording.messages()}
    depth = decode_image(messages["fused/depth"].payload)
    assert depth.shape == (8, 12)
    assert np.nanmax(np.abs(depth - 20_000 * 7.5 / 65536)) < 0.01
    report = json.loads(messages["fused/report"].payload)
    assert report["burst"] == 0
    assert report["method"] == "nearest"
    assert {"camera/calibration", "stage/transform", "status"} <= messages.keys()


def test_the_scan_loop_goes_on_through_a_lost_camera(configure) -> None:
    lost = rig(faults={9: DeviceLostError("unplugged")})
    summary = Daemon(configure(), lost, watch=StopAfter(3)).run()
    assert summary.maps >= 3
    assert lost.reopened == 1
    assert not lost.camera.is_open
    assert not lost.stage.is_open


def test_after_a_failed_movement_it_stands_still_says_why_and_stays_alive(configure, monkeypatch) -> None:
    fed: list[str] = []
    monkeypatch.setattr("service.health.monitor.notify", lambda *lines: fed.extend(lines))
    stuck = rig()
    stuck.stage.faults = {9: LimitError("ran into its limit")}
    daemon = Daemon(configure(), stuck)
    thread = Thread(target=daemon.run)
    thread.start()
    try:
        until = time.monotonic() + 60
        while not (hasattr(daemon, "_monitor") and daemon._monitor.state == "idle"):
            assert time.monotonic() < until
            time.sleep(0.01)
        status = daemon._monitor.status()
        assert status.error == "ran into its limit; it stands still until started again"
        moves = len(stuck.stage.moves)
        fed.clear()
        for _ in range(3):
            daemon._monitor.tell_systemd(daemon._monitor.status())
        assert fed.count(WATCHDOG) >= 3, "killed and started again it would move by itself"
        assert len(stuck.stage.moves) == moves == 10
    finally:
        daemon.stop.set()
        thread.join()


def test_one_pass_ends_with_a_failed_movement(configure) -> None:
    stuck = rig()
    stuck.stage.faults = {2: LimitError("ran into its limit")}
    with pytest.raises(MotionError, match="ran into its limit"):
        Daemon(configure(), stuck, once=True).run()


def test_recorded_bursts_are_all_fused_in_order(configure) -> None:
    frames = [frame(k, k * 1000, burst=k // 4, pose=k % 4) for k in range(24)]
    summary = Daemon(configure(), rig(carried=frames), once=True).run()
    assert [b.report.burst for b in summary.fused] == list(range(6))
    assert summary.lost == ()


def test_a_burst_that_cannot_be_fused_is_said_to_be_lost(configure) -> None:
    blind = np.zeros((4, 6), np.uint16)
    frames: list[Frame] = [frame(k, k * 1000, burst=k // 4, pose=k % 4) for k in range(12)]
    frames[4:8] = [frame(k, k * 1000, burst=1, pose=k % 4, counts=blind) for k in range(4, 8)]
    summary = Daemon(configure(), rig(carried=frames), once=True).run()
    assert [b.report.burst for b in summary.fused] == [0, 2]
    assert len(summary.lost) == 1
    assert summary.lost[0].startswith("burst 1 not fused: distance has no valid pixel")


def test_without_one_map_it_fails_and_leaves_nothing(configure, tmp_path: Path) -> None:
    blind = np.zeros((4, 6), np.uint16)
    frames = [frame(k, k * 1000, burst=0, pose=k, counts=blind) for k in range(4)]
    with pytest.raises(ServiceError, match=r"no burst could be fused: burst 0 .* no valid pixel"):
        Daemon(configure(), rig(carried=frames), output=tmp_path / "out", once=True).run()
    assert not (tmp_path / "out").exists()


def test_a_plan_out_of_reach_fails_before_anything_is_written(configure, tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="pose 0 of the plan"):
        Daemon(configure(plan={"pan": 90.0}), rig(), output=tmp_path / "out", once=True).run()
    assert not (tmp_path / "out").exists()


def test_a_port_in_use_is_one_clear_line_and_leaves_nothing(configure, endpoint: str, tmp_path: Path) -> None:
    with open_session(listen=[endpoint]), pytest.raises(SessionError, match="in use by") as caught:
        Daemon(configure(), rig(), output=tmp_path / "out", once=True).run()
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_existing_directory_keeps_what_was_in_it(configure, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    with pytest.raises(PlanError):
        Daemon(configure(plan={"pan": 90.0}), rig(), output=tmp_path / "out", once=True).run()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]
