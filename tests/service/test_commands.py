"""A service commanded from another process, with nothing but Zenoh and JSON."""

import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event as Flag

import numpy as np
import pytest
from commanding import configuration, running, stranger
from scripted import SHAPE, ScriptedCamera, ScriptedStage

from drivers import Capabilities
from drivers.clock import VirtualClock
from drivers.recording import attachments
from drivers.simulation.render import Truth
from service.capture.rig import Rig
from service.messages.events import BurstCaptured, Commanded, HeadChanged, MapFused, ScanProgressed


class HastyClock(VirtualClock):
    """Twenty times as fast as the real one."""

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        time.sleep(max(0.0, seconds) / 20)


def hasty_rig(**script: object) -> Rig:
    clock = HastyClock(1_700_000_000_000_000_000)
    return Rig(ScriptedCamera(clock, **script), ScriptedStage(clock), clock)  # type: ignore[arg-type]


def test_a_scan_is_started_paused_resumed_and_stopped(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        assert far.ask("cmd/scan", action="start")["state"] == "scanning"
        service.wait(lambda: len(service.of(MapFused)) >= 2)
        assert far.ask("cmd/scan", action="pause") | {"reason": ""} == {
            "state": "scanning",
            "reason": "",
            "paused": True,
        }
        refused = far.ask("cmd/settings", action="set", integration_time=0.01)
        assert refused["code"] == "INVALID_STATE"
        assert "paused in a burst" in refused["message"]
        assert far.ask("cmd/scan", action="stop")["code"] == "INVALID_STATE"
        assert far.ask("cmd/scan", action="resume")["paused"] is False
        bursts = len(service.of(BurstCaptured))
        service.wait(lambda: len(service.of(BurstCaptured)) > bursts)
        far.ask("cmd/scan", action="stop")
        service.wait_state("idle")
        assert far.ask("cmd/scan", action="resume")["code"] == "INVALID_STATE"
        asked = [(event.command, event.arguments["action"]) for event in service.of(Commanded)]
        assert asked == [("cmd/scan", verb) for verb in ("start", "pause", "resume", "stop")]


def test_a_cancelled_burst_leaves_nothing_and_the_next_has_another_number(
    tmp_path: Path, endpoint: str
) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/scan", action="start")
        service.wait(lambda: len(service.of(BurstCaptured)) >= 1)
        far.ask("cmd/scan", action="pause")
        assert far.ask("cmd/scan", action="cancel")["paused"] is False
        service.wait_state("idle")
        numbers = [event.burst.id for event in service.of(BurstCaptured)]
        far.ask("cmd/scan", action="once")
        after = [event.burst.id for event in service.of(BurstCaptured)]
        assert after[:-1] == numbers
        assert after[-1] > numbers[-1] + 1


def test_one_burst_is_answered_with_its_report_and_map(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        reply = far.ask("cmd/scan", action="once")
        assert reply["report"]["frames"] == 4
        assert reply["report"]["method"] == "nearest"
        service.wait_state("idle")
        far.send("lidarboost/rig/cmd/scan", payload=json.dumps({"action": "once", "map": True}))
        first, *messages = far.replies()
        assert first["ok"]["report"]["burst"] == reply["report"]["burst"] + 1
        assert [m["attachment"] for m in messages] == [
            "fused/calibration",
            "fused/transform",
            "fused/depth",
            "fused/deviation",
            "fused/amplitude",
            "fused/reason",
            "fused/report",
        ]
        assert messages[2]["encoding"] == "application/protobuf;foxglove.RawImage"
        assert {m["key"] for m in messages} == {"lidarboost/rig/cmd/scan"}
        assert len(service.of(BurstCaptured)) == 2


def test_one_burst_takes_its_turn_while_scanning(tmp_path: Path, endpoint: str) -> None:
    settings = configuration(tmp_path, endpoint, start="scan", plan={"pause": 3600})
    with running(settings, hasty_rig(), "scanning") as service, stranger(endpoint) as far:
        service.wait(lambda: len(service.of(BurstCaptured)) == 1)  # and an hour of rest
        assert far.ask("cmd/scan", action="once")["report"]["burst"] == 1
        assert service.daemon.states.state == "scanning"


def test_a_setting_is_in_force_with_the_next_burst(tmp_path: Path, endpoint: str) -> None:
    rig = hasty_rig()
    with running(configuration(tmp_path, endpoint, start="scan"), rig, "scanning"), stranger(endpoint) as far:
        assert far.ask("cmd/settings", action="get")["settings"]["integration_time"] == 0.03
        reply = far.ask("cmd/settings", action="set", integration_time=0.01)
        assert reply["settings"]["integration_time"] == 0.01
        assert reply["state"] == "scanning"
        assert rig.settings is not None
        assert rig.settings.integration_time == 0.01
        assert far.ask("cmd/settings", action="get")["settings"] == reply["settings"]


def test_plan_and_fusion_are_changed_by_the_fields_that_change(tmp_path: Path, endpoint: str) -> None:
    settings = configuration(tmp_path, endpoint, start="scan")
    with running(settings, hasty_rig(), "scanning") as service, stranger(endpoint) as far:
        reply = far.ask("cmd/plan", action="set", span=2.0, axes="pan")
        assert (reply["plan"]["span"], reply["plan"]["axes"], reply["plan"]["pan"]) == (2.0, "pan", 0.0)
        reply = far.ask("cmd/fusion", action="set", frames=3, method="bicubic", regularization=0.5)
        assert (reply["fusion"]["frames"], reply["fusion"]["upsampling"]) == (3, 2)
        report = far.ask("cmd/scan", action="once")["report"]
        assert (report["method"], report["frames"]) == ("bicubic", 3)
        before = far.ask("cmd/plan", action="get")["plan"]
        for refused, code in (
            ({"pan": 100.0}, "OUT_OF_RANGE"),
            ({"pan": 1000.0}, "OUT_OF_RANGE"),
            ({"axes": "roll"}, "INVALID_ARGUMENT"),
            ({"frames": 3}, "INVALID_ARGUMENT"),
            ({"nearest": 10.0}, "INVALID_ARGUMENT"),
        ):
            assert far.ask("cmd/plan", action="set", **refused)["code"] == code
        assert far.ask("cmd/plan", action="get")["plan"] == before
        assert far.ask("cmd/plan", action="set", farthest=20.0)["plan"]["farthest"] == 20.0
        assert far.ask("cmd/plan", action="set", nearest=10.0)["plan"]["nearest"] == 10.0
        heads = [event.head for event in service.of(HeadChanged)]
        used = next(data for name, data, _ in heads[-1].attachments if "configuration" in name)
        assert b'method = "bicubic"' in used
        assert b"span = 2.0" in used


class SimulatingCamera(ScriptedCamera):
    """Knows the truth, and renders it as soon as it is let go."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(clock)
        self.asked: list[int] = []
        self.let_go = Flag()
        self.let_go.set()

    def _capabilities(self) -> Capabilities:
        return replace(super()._capabilities(), source="simulation")

    def truth_renderer(self, upsampling: int) -> Callable[[], Truth]:
        def render() -> Truth:
            self.asked.append(upsampling)
            assert self.let_go.wait(60)
            image = np.full((upsampling * SHAPE[0], upsampling * SHAPE[1]), upsampling, np.float32)
            return Truth(image, image, image)

        return render


def test_while_a_truth_is_rendered_commands_are_served_and_maps_are_made(
    tmp_path: Path, endpoint: str
) -> None:
    clock = HastyClock(1_700_000_000_000_000_000)
    camera = SimulatingCamera(clock)
    rig = Rig(camera, ScriptedStage(clock), clock)  # type: ignore[arg-type]
    with running(configuration(tmp_path, endpoint), rig) as service, stranger(endpoint) as far:

        def attached() -> list[bytes]:
            head = service.of(HeadChanged)[-1].head
            return [content for name, content, _ in head.attachments if name == attachments.TRUTH]

        def judged() -> float | None:
            far.ask("cmd/scan", action="once")
            truth = service.of(MapFused)[-1].truth
            return None if truth is None else float(truth[0, 0])

        assert (len(attached()), judged()) == (1, 2.0)
        camera.let_go.clear()
        assert far.ask("cmd/fusion", action="set", upsampling=3)["fusion"]["upsampling"] == 3
        service.wait(lambda: camera.asked == [2, 3])
        assert far.ask("cmd/plan", action="set", span=0.5)["plan"]["span"] == 0.5
        assert (len(attached()), judged()) == (0, None)
        for upsampling in (4, 5):
            assert far.ask("cmd/fusion", action="set", upsampling=upsampling)["state"] == "idle"
        camera.let_go.set()
        service.wait(lambda: len(attached()) == 1)
        assert camera.asked == [2, 3, 5]
        assert judged() == 5.0
        assert far.ask("cmd/plan", action="set", span=1.0)["plan"]["span"] == 1.0
        assert (camera.asked, len(attached())) == ([2, 3, 5], 1)


def test_a_stream_is_started_changed_and_stopped(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        reply = far.ask("cmd/stream", action="start", window=3)
        assert (reply["state"], reply["stream"]["window"]) == ("streaming", 3)
        service.wait(lambda: any(event.map.report.frames == 3 for event in service.of(MapFused)))
        assert far.ask("cmd/scan", action="once")["code"] == "INVALID_STATE"
        assert far.ask("cmd/scan", action="pause")["code"] == "INVALID_STATE"
        maps = len(service.of(MapFused))
        assert far.ask("cmd/fusion", action="set", fill=1.0)["state"] == "streaming"
        service.wait(lambda: any(e.map.report.burst == 0 for e in service.of(MapFused)[maps:]))  # anew
        assert far.ask("cmd/scan", action="start")["state"] == "scanning"
        assert far.ask("cmd/stream", action="stop")["code"] == "INVALID_STATE"
        assert far.ask("cmd/stream", action="start")["state"] == "streaming"
        far.ask("cmd/stream", action="stop")
        service.wait_state("idle")


def test_manifest_and_schemas_tell_a_stranger_all_it_needs(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()), stranger(endpoint) as far:
        [reply] = far.query("lidarboost/rig/manifest")
        manifest = reply["ok"]
        assert (manifest["rig"], manifest["model"], manifest["state"]) == (
            "lidarboost/rig",
            "scripted",
            "idle",
        )
        depth = next(topic for topic in manifest["topics"] if topic["name"] == "fused/depth")
        assert (depth["schema_name"], depth["unit"], depth["rate"]) == (
            "foxglove.RawImage",
            "m",
            "each fusion",
        )
        scan = next(command for command in manifest["commands"] if command["name"] == "cmd/scan")
        assert scan["actions"]["once"] == "One burst; answered once its map is published."
        names = {entry["name"] for entry in manifest["topics"] + manifest["commands"]} - {"alive"}
        found = far.query("lidarboost/rig/schema/**")
        assert {one["key"].removeprefix("lidarboost/rig/schema/") for one in found} == names
        [reply] = far.query("lidarboost/rig/schema/cmd/plan")
        fields = reply["ok"]["request"]["$defs"]["Set"]["properties"]
        assert fields["span"]["maximum"] == 40
        assert "low-resolution pixels" in fields["span"]["description"]
        assert reply["ok"]["reply"]["required"] == ["state", "reason", "plan"]
        [reply] = far.query("lidarboost/rig/schema/fused/depth")
        assert reply["encoding"] == "application/protobuf;google.protobuf.FileDescriptorSet"


def test_progress_is_told_pose_by_pose(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        far.ask("cmd/scan", action="once")
        service.wait_state("idle")
        told = [event.progress for event in service.of(ScanProgressed)]
        assert [(one.burst, one.captured, one.poses) for one in told[:4]] == [(0, k, 4) for k in (1, 2, 3, 4)]
        assert told[0].seconds is None
        assert told[3].seconds == 0
        service.wait(lambda: service.of(ScanProgressed)[-1].progress.fusing == 0)
        [reply] = far.query("lidarboost/rig/scan/progress")
        assert reply["ok"]["captured"] == 4


def test_where_the_stage_is_can_be_asked_in_a_pause(tmp_path: Path, endpoint: str) -> None:
    settings = configuration(tmp_path, endpoint, start="scan")
    with running(settings, hasty_rig(), "scanning"), stranger(endpoint) as far:
        assert far.ask("cmd/scan", action="pause")["paused"]
        reply = far.ask("cmd/stage", action="get")
        assert abs(reply["pan"]) < 0.01
        assert reply["pan_limits"] == [-1.0, 1.0]


def test_a_newcomer_adds_a_command_in_one_file(
    tmp_path: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from service.daemon import commands as folder

    page = Path(folder.__file__).with_name("README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, flags=re.S)
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "beam.py").write_text(example)
    monkeypatch.setattr(folder, "__path__", [*folder.__path__, str(tmp_path / "more")])
    folder.commands.cache_clear()
    try:
        assert "| `cmd/beam` | `aim` | Where the beam points. |" in folder.command_table()
        with running(configuration(tmp_path, endpoint), hasty_rig()), stranger(endpoint) as far:
            assert far.ask("cmd/beam", action="aim", pan=0.5) | {"reason": ""} == {
                "state": "idle",
                "reason": "",
                "paused": False,
                "pan": pytest.approx(0.5, abs=1e-3),
            }
            assert far.ask("cmd/beam", action="aim", pan=7)["code"] == "OUT_OF_RANGE"
    finally:
        folder.commands.cache_clear()
