"""What touches no device is answered at once, whatever the devices do; a lost device is told by its code."""

import time
from pathlib import Path
from statistics import median

import pytest
from commanding import Stranger, configuration, running, stranger
from scripted import ScriptedCamera, ScriptedStage

from drivers import DeviceLostError, DeviceTimeoutError, Frame, NotAvailableError
from drivers.clock import SystemClock
from service.capture.rig import Rig
from service.messages.events import BurstCaptured, StatusTold

pytestmark = pytest.mark.slow

AT_ONCE = 0.3
"""Seconds: the target is 0.05, with room for a machine that is busy with other tests."""


class StuckCamera(ScriptedCamera):
    """Gives no frame once it is `stuck`, and cannot be opened while it is `away`."""

    stuck = away = False

    def _grab(self, timeout: float) -> Frame:
        if self.stuck:
            time.sleep(timeout)
            raise DeviceTimeoutError("no frame came")
        return super()._grab(timeout)

    def _open(self) -> None:
        if self.away:
            raise NotAvailableError("there is no camera")
        super()._open()


@pytest.fixture
def rig() -> Rig:
    clock = SystemClock()
    return Rig(StuckCamera(clock), ScriptedStage(clock), clock)  # type: ignore[arg-type]


def seconds_of(far: Stranger, *requests: tuple[str, dict[str, object]]) -> list[float]:
    taken = []
    for name, request in requests:
        far.ask(name, **request)
        taken.append(far.seconds)
    return taken


def test_a_camera_that_hangs_holds_up_nothing_but_what_needs_it(
    tmp_path: Path, endpoint: str, rig: Rig
) -> None:
    settings = configuration(tmp_path, endpoint, start="scan", camera={"timeout": 1.5})
    with running(settings, rig, "scanning") as service, stranger(endpoint) as far:
        service.wait(lambda: len(service.of(BurstCaptured)) >= 1)
        rig.camera.stuck = True
        time.sleep(0.1)
        gets = [(f"cmd/{name}", {"action": "get"}) for name in ("settings", "plan", "fusion")]
        assert max(seconds_of(far, *gets, ("cmd/scan", {"action": "pause"}))) < AT_ONCE
        began = time.monotonic()
        assert far.query("lidarboost/rig/manifest")
        assert time.monotonic() - began < AT_ONCE
        assert max(seconds_of(far, ("cmd/scan", {"action": "cancel"}))) < AT_ONCE
        service.wait_state("idle")
        assert time.monotonic() - began < 2 * 1.5 + 1  # one exposure, as long as it may take


def test_while_a_device_is_lost_what_needs_it_is_refused_at_once(
    tmp_path: Path, endpoint: str, rig: Rig
) -> None:
    settings = configuration(tmp_path, endpoint, start="scan")
    with running(settings, rig, "scanning") as service, stranger(endpoint) as far:
        service.wait(lambda: len(service.of(BurstCaptured)) >= 1)
        rig.camera.away = True
        rig.camera.faults = {rig.camera.calls + 1: DeviceLostError("unplugged")}
        service.wait_state("recovering")
        for name, request in (
            ("cmd/scan", {"action": "once"}),
            ("cmd/scan", {"action": "start"}),
            ("cmd/stream", {"action": "start"}),
            ("cmd/plan", {"action": "set", "span": 2.0}),
        ):
            reply = far.ask(name, **request)
            assert (reply["code"], far.seconds < AT_ONCE) == ("UNAVAILABLE", True)
            assert "unplugged" in reply["message"]
        assert "pan" in far.ask("cmd/stage", action="get")
        assert far.ask("cmd/scan", action="stop")["state"] == "recovering"
        assert far.ask("cmd/plan", action="get")["plan"]["span"] == 1.0
        rig.camera.away = False
        service.wait_state("idle")
        assert far.ask("cmd/scan", action="once")["report"]["frames"] == 4


def test_answers_come_at_once_while_it_scans_and_fuses(tmp_path: Path, endpoint: str, rig: Rig) -> None:
    settings = configuration(tmp_path, endpoint, start="stream", stream={"window": 2})
    with running(settings, rig, "streaming"), stranger(endpoint) as far:
        taken = seconds_of(far, *[("cmd/fusion", {"action": "get"})] * 30)
        assert median(taken) < AT_ONCE


def test_the_last_error_is_told_with_its_time_and_gone_when_it_is_over(
    tmp_path: Path, endpoint: str, rig: Rig
) -> None:
    settings = configuration(tmp_path, endpoint, start="scan")
    with running(settings, rig, "scanning") as service:
        service.wait(lambda: len(service.of(BurstCaptured)) >= 1)
        rig.camera.away = True
        rig.camera.faults = {rig.camera.calls + 1: DeviceLostError("unplugged")}
        service.wait_state("recovering")
        service.wait(lambda: bool(service.of(StatusTold)[-1].status.error))
        error = service.of(StatusTold)[-1].status.error
        assert "unplugged" in error.what
        assert abs(error.timestamp - time.time_ns()) < 10e9
        rig.camera.away = False
        service.wait_state("scanning")
        service.wait(lambda: service.of(StatusTold)[-1].status.error is None)
