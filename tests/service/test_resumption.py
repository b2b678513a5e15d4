"""A scan that was interrupted goes on from its last whole pose, where everything is as it was."""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commanding import configuration, running
from scripted import ScriptedCamera, ScriptedStage

from drivers.clock import VirtualClock
from drivers.recording import open_recording
from service.capture.resumption import LONGEST_BREAK
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.messages.events import BurstCaptured, Commanded, FrameCaptured

pytestmark = pytest.mark.faults

POSES = 12

AHEAD = 120.0
"""Seconds from one run to the next."""


class HastyClock(VirtualClock):
    """Twenty times as fast as the real one."""

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        time.sleep(max(0.0, seconds) / 20)


def made_rig(ahead: float = 0.0) -> Rig:
    clock = HastyClock(1_700_000_000_000_000_000 + round(ahead * 1e9))
    return Rig(ScriptedCamera(clock), ScriptedStage(clock), clock)


@pytest.fixture
def configured(tmp_path: Path, endpoint: str) -> Callable[..., Configuration]:
    recording = {"enabled": True, "directory": str(tmp_path / "recordings")}

    def make(**sections: Any) -> Configuration:
        fusion = {"frames": POSES, **sections.pop("fusion", {})}
        return configuration(tmp_path, endpoint, start="scan", recording=recording, fusion=fusion, **sections)

    return make


def interrupted(settings: Configuration, command: str | None = None) -> int:
    """Scan, and end in the middle of the second burst; how many poses of it were captured."""
    with running(settings, made_rig(), "scanning") as service:
        service.wait(lambda: any(e.frame.burst == 1 and e.frame.pose == 2 for e in service.of(FrameCaptured)))
        service.daemon.control.pause()
        service.wait(lambda: len(service.of(BurstCaptured)) == 1)
        if command is not None:
            now = service.rig.clock.now() + 10**9
            service.daemon.emit(Commanded("somebody", now, "cmd/scan", {"action": command}))
    poses = [event.frame.pose for event in service.of(FrameCaptured) if event.frame.burst == 1]
    assert poses == list(range(len(poses)))
    assert 3 <= len(poses) < POSES
    return len(poses)


def first_burst(settings: Configuration, ahead: float) -> BurstCaptured:
    """Of another run, so many seconds later: the first burst, whose frames have all been shown."""
    with running(settings, made_rig(ahead), "scanning") as service:
        service.wait(lambda: len(service.of(BurstCaptured)) >= 1)
        burst: BurstCaptured = service.of(BurstCaptured)[0]
        shown = [event for event in service.of(FrameCaptured) if event.frame.burst == burst.burst.id]
        assert len(shown) == POSES
    return burst


def test_it_is_resumed_from_its_last_whole_pose(
    configured: Callable[..., Configuration], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    done = interrupted(configured())
    event = first_burst(configured(), AHEAD)
    assert event.burst.id == 1
    assert [frame.pose for frame in event.burst.frames] == list(range(POSES))
    times = [frame.timestamp for frame in event.burst.frames]
    longest = max(range(1, POSES), key=lambda k: times[k] - times[k - 1])
    assert longest == done  # the break is where it was interrupted
    assert f"burst 1 is resumed at pose {done} of {POSES}" in caplog.text
    files = sorted(Path(configured().recording.directory).glob("*.mcap"))
    assert {1} <= {entry.fields.burst for entry in open_recording(files[-1]).entries}


@pytest.mark.parametrize(
    ("sections", "ahead", "command", "why"),
    [
        ({"plan": {"span": 2.0}}, AHEAD, None, "plan differ from what was interrupted"),
        ({}, LONGEST_BREAK + AHEAD, None, "s old, at most 600 s are allowed"),
        ({}, AHEAD, "cancel", "it was ended on command"),
        ({}, AHEAD, "set", "settings were changed on command"),
    ],
)
def test_otherwise_it_begins_anew_and_says_so(
    configured: Callable[..., Configuration],
    caplog: pytest.LogCaptureFixture,
    sections: dict[str, Any],
    ahead: float,
    command: str | None,
    why: str,
) -> None:
    caplog.set_level(logging.INFO)
    interrupted(configured(), command)
    event = first_burst(configured(**sections), ahead)
    assert event.burst.id == 0
    assert "the scan begins anew: " in caplog.text
    assert why in caplog.text
