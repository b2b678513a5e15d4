"""The daemon in one process: scan loop, faults, outputs, and nothing half-written after an error."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripted import ScriptedCamera, ScriptedStage, frame

from drivers import DeviceLostError, Frame, LimitError
from drivers.clock import VirtualClock
from drivers.messages import decode_image
from drivers.recording import open_recording
from service.capture.rig import Rig
from service.config.file import load
from service.config.sections import Configuration
from service.daemon.daemon import Daemon
from service.daemon.modes import Scanning
from service.daemon.run import run_service
from service.daemon.systemd import WATCHDOG
from service.errors import ConfigurationError, MotionError, PlanError, ServiceError, SessionError
from service.messages.events import DevicesOpened, Event, FrameCaptured, MapFused, StateChanged, StatusTold
from service.messages.status import Status
from service.messages.summary import RunSummary
from service.sinks.sink import Sink
from service.wire.session import open_session

FUSION = {"method": "nearest", "upsampling": 2, "register_poses": False, "frames": 4}


@pytest.fixture
def configure(tmp_path: Path, endpoint: str) -> Callable[..., Configuration]:
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))

    def configure(**sections: Any) -> Configuration:
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


class StopAfter(Sink):
    """Stops the daemon after some maps, and keeps every event."""

    def __init__(self, maps: int, seen: list[Event]) -> None:
        super().__init__()
        self.maps, self.seen = maps, seen

    def started(self, daemon: Daemon) -> None:
        self.daemon = daemon

    def take(self, event: Event) -> None:
        self.seen.append(event)
        if sum(isinstance(one, MapFused) for one in self.seen) >= self.maps:
            self.daemon.stop.set()


def run_until(configuration: Configuration, rig: Rig, maps: int) -> tuple[RunSummary, list[Event]]:
    seen: list[Event] = []
    sink = StopAfter(maps, seen)
    return run_service(configuration, rig, sinks={"test": lambda: sink}, started=sink.started), seen


def test_one_burst_of_the_plan_is_captured_fused_and_written(configure, tmp_path: Path) -> None:
    output = tmp_path / "out" / "deep"
    summary = run_service(configure(), rig(), output=output, once=True)
    assert (summary.frames, summary.bursts, summary.maps, summary.lost) == (4, 1, 1, ())
    assert summary.fused[0].report.used == (0, 1, 2, 3)
    assert sorted(path.name for path in output.iterdir()) == ["burst-0000.png", "fused.mcap"]
    assert {Path(name).name for name in summary.files} == {"burst-0000.png", "fused.mcap"}
    assert (output / "burst-0000.png").read_bytes().startswith(b"\x89PNG")

    recording = open_recording(output / "fused.mcap")
    assert recording.damage is None
    assert recording.frame_count == 4
    assert recording.metadata["camera_model"] == "scripted"
    assert recording.planned == 4
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
    summary, events = run_until(configure(), lost, 3)
    assert summary.maps >= 3
    assert lost.reopened == 1
    states = [event.state for event in events if isinstance(event, StateChanged)]
    assert states[-3:] == ["recovering", "scanning", "stopping"] or states[-2:] == ["recovering", "scanning"]
    assert not lost.camera.is_open
    assert not lost.stage.is_open


def test_after_a_failed_movement_it_stands_still_says_why_and_stays_alive(configure, monkeypatch) -> None:
    fed: list[str] = []
    monkeypatch.setattr("service.daemon.monitor.notify", lambda *lines: fed.extend(lines))
    stuck = rig()
    stuck.stage.faults = {9: LimitError("ran into its limit")}
    statuses: list[Status] = []

    class Watches(Sink):
        def started(self, daemon: Daemon) -> None:
            self.daemon = daemon

        def take(self, event: Event) -> None:
            if isinstance(event, StatusTold) and event.status.state == "idle":
                if not statuses:
                    fed.clear()
                statuses.append(event.status)
                if len(statuses) == 4:
                    self.daemon.stop.set()

    sink = Watches()
    run_service(configure(), stuck, sinks={"test": lambda: sink}, started=sink.started)
    assert statuses[0].reason == "ran into its limit; it stands still until started again"
    assert statuses[0].error is not None
    assert statuses[0].degraded[0].what == statuses[0].error.what == statuses[0].reason
    assert fed.count(WATCHDOG) >= 2, "killed and started again it would move by itself"
    assert len(stuck.stage.moves) == 10


def test_one_pass_that_is_stopped_before_its_first_map_is_interrupted_and_leaves_nothing(
    configure, tmp_path: Path
) -> None:
    class Stops(Sink):
        wants = (FrameCaptured,)

        def started(self, daemon: Daemon) -> None:
            self.daemon = daemon

        def take(self, event: Event) -> None:  # noqa: ARG002
            self.daemon.stop.set()

    sink, out = Stops(), tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run_service(
            configure(), rig(), once=True, output=out, sinks={"test": lambda: sink}, started=sink.started
        )
    assert not out.exists()


def test_one_pass_ends_with_a_failed_movement(configure) -> None:
    stuck = rig()
    stuck.stage.faults = {2: LimitError("ran into its limit")}
    with pytest.raises(MotionError, match="ran into its limit"):
        run_service(configure(), stuck, once=True)


def test_recorded_bursts_are_all_fused_in_order(configure) -> None:
    frames = [frame(k, k * 1000, burst=k // 4, pose=k % 4) for k in range(24)]
    summary = run_service(configure(), rig(carried=frames), once=True)
    assert [b.report.burst for b in summary.fused] == list(range(6))
    assert summary.lost == ()


def test_a_burst_that_cannot_be_fused_is_said_to_be_lost(configure) -> None:
    blind = np.zeros((4, 6), np.uint16)
    frames: list[Frame] = [frame(k, k * 1000, burst=k // 4, pose=k % 4) for k in range(12)]
    frames[4:8] = [frame(k, k * 1000, burst=1, pose=k % 4, counts=blind) for k in range(4, 8)]
    summary = run_service(configure(), rig(carried=frames), once=True)
    assert [b.report.burst for b in summary.fused] == [0, 2]
    assert len(summary.lost) == 1
    assert summary.lost[0].startswith("burst 1 not fused: distance has no valid pixel")


def test_without_one_map_it_fails_and_leaves_nothing(configure, tmp_path: Path) -> None:
    blind = np.zeros((4, 6), np.uint16)
    frames = [frame(k, k * 1000, burst=0, pose=k, counts=blind) for k in range(4)]
    with pytest.raises(ServiceError, match=r"no burst could be fused: burst 0 .* no valid pixel"):
        run_service(configure(), rig(carried=frames), output=tmp_path / "out", once=True)
    assert not (tmp_path / "out").exists()


def test_a_plan_out_of_reach_fails_before_anything_is_written(configure, tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="pose 0 of the plan"):
        run_service(configure(plan={"pan": 90.0}), rig(), output=tmp_path / "out", once=True)
    assert not (tmp_path / "out").exists()


def test_a_port_in_use_is_one_clear_line_and_leaves_nothing(configure, endpoint: str, tmp_path: Path) -> None:
    with open_session(listen=[endpoint]), pytest.raises(SessionError, match="in use by") as caught:
        run_service(configure(), rig(), output=tmp_path / "out", once=True)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_existing_directory_keeps_what_was_in_it(configure, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    with pytest.raises(PlanError):
        run_service(configure(plan={"pan": 90.0}), rig(), output=tmp_path / "out", once=True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]


def test_a_stream_gives_a_map_for_every_frame_of_a_lossless_run(configure, tmp_path: Path) -> None:
    frames = [frame(k, k * 1000, burst=k // 4, pose=k % 4) for k in range(12)]
    settings = configure(stream={"window": 3}, start="stream")
    summary = run_service(settings, rig(carried=frames), output=tmp_path / "out", once=True)
    assert (summary.frames, summary.maps, summary.lost) == (12, 12, ())
    assert [b.report.burst for b in summary.fused] == list(range(12))
    assert [b.report.frames for b in summary.fused] == [1, 2, *[3] * 10]
    assert summary.fused[-1].report.sequence == (9, 10, 11)
    assert len(list((tmp_path / "out").glob("burst-*.png"))) == 12


@pytest.mark.slow
def test_two_replays_of_a_stream_give_the_same_bits(configure, tmp_path: Path) -> None:
    frames = [frame(k, k * 1000, counts=20_000 + textured(k)) for k in range(8)]
    settings = configure(stream={"window": 4}, start="stream", fusion={"method": "lidarboost"})
    depths = []
    for name in ("a", "b"):
        run_service(settings, rig(carried=frames), output=tmp_path / name, once=True)
        recording = open_recording(tmp_path / name / "fused.mcap")
        depths.append([m.payload for m, _ in recording.messages() if m.topic == "fused/depth"])
    assert len(depths[0]) == 8
    assert depths[0] == depths[1]


def textured(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 30, (4, 6)).astype(np.uint16)


def test_a_live_stream_lets_the_newest_frames_win_and_counts_the_others(configure) -> None:
    settings = configure(stream={"window": 3}, start="stream")
    summary, events = run_until(settings, rig(), 5)
    assert summary.maps >= 5
    opened = next(event for event in events if isinstance(event, DevicesOpened))
    assert opened.frames is None
    assert "streaming" in [event.state for event in events if isinstance(event, StateChanged)]
    assert all(event.map.report.missing == 0 for event in events if isinstance(event, MapFused))


def test_an_idle_service_captures_nothing_until_it_is_asked(configure) -> None:
    idle, seen = rig(), []
    states: list[str] = []

    class Asks(Sink):
        def started(self, daemon: Daemon) -> None:
            self.daemon = daemon

        def take(self, event: Event) -> None:
            if isinstance(event, StateChanged):
                states.append(event.state)
                if event.state == "idle" and not seen:
                    assert self.daemon.grabber.counts.frames == 0
                    self.daemon.begin(Scanning(self.daemon))
            elif isinstance(event, MapFused):
                seen.append(event)
                self.daemon.rest()
                if len(states) > 3:
                    self.daemon.stop.set()
            if states[-1:] == ["idle"] and seen:
                self.daemon.stop.set()

    sink = Asks()
    run_service(configure(start="idle"), idle, sinks={"test": lambda: sink}, started=sink.started)
    assert states[:4] == ["starting", "idle", "scanning", "idle"]
    assert len(seen) >= 1


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({"kind": "nowhere"}, "sinks.x.kind = 'nowhere' cannot be loaded: no sink of that name is installed"),
        ({"kind": "no.such:Thing"}, "sinks.x.kind = 'no.such:Thing' cannot be loaded: No module named 'no'"),
        ({"kind": "json:dumps"}, "sinks.x.kind = 'json:dumps' is no Sink"),
        (
            {"kind": "service.sinks.summaries:Summaries", "options": {"colour": 1}},
            "sinks.x.options: colour: Extra inputs are not permitted",
        ),
    ],
)
def test_a_sink_that_cannot_be_used_is_one_clear_line(
    configure, tmp_path: Path, section: dict[str, object], said: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        run_service(configure(sinks={"x": section}), rig(), output=tmp_path / "out", once=True)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
