"""`cmd/stage`: stopped at once, never moved again unasked, homed by consent."""

import time
from pathlib import Path

from commanding import configuration, running, stranger
from scripted import ScriptedCamera, ScriptedStage
from test_commands import HastyClock, hasty_rig

from service.capture.rig import Rig


class SlowStage(ScriptedStage):
    """Takes a minute for a movement, by the real clock, unless it is stopped."""

    def _remaining(self) -> float:
        time.sleep(0.005)
        return 60.0 if self._arrival else 0.0


def slow_rig() -> Rig:
    clock = HastyClock(1_700_000_000_000_000_000)
    return Rig(ScriptedCamera(clock), SlowStage(clock), clock)


def test_a_stage_that_moves_is_stopped_at_once_and_the_scan_with_it(tmp_path: Path, endpoint: str) -> None:
    settings = configuration(tmp_path, endpoint, start="scan", stage={"timeout": 300})
    with running(settings, slow_rig(), "scanning") as service, stranger(endpoint) as far:
        service.wait(lambda: len(service.rig.stage.moves) == 1)
        began = time.monotonic()
        reply = far.ask("cmd/stage", action="stop")
        assert time.monotonic() - began < 3
        assert reply["uncertainty"] is None
        assert service.rig.stage.stops >= 1
        service.wait_state("idle")
        assert len(service.rig.stage.moves) == 1


def test_a_stage_stopped_in_a_pause_does_not_move_again(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        for _ in range(5):  # which thread is first is chance
            begun = len(service.rig.stage.moves)
            far.ask("cmd/scan", action="start")
            service.wait(lambda begun=begun: len(service.rig.stage.moves) > begun)
            far.ask("cmd/scan", action="pause")
            far.ask("cmd/stage", action="get")  # answered where it stands still
            moves = list(service.rig.stage.moves)
            assert "code" not in far.ask("cmd/stage", action="stop")
            service.wait_state("idle")
            assert service.rig.stage.moves == moves


def test_homing_needs_idle_and_is_stopped_by_stop(tmp_path: Path, endpoint: str) -> None:
    with (
        running(configuration(tmp_path, endpoint), slow_rig()) as service,
        stranger(endpoint) as far,
        stranger(endpoint) as other,
    ):
        far.send("lidarboost/rig/cmd/stage", payload='{"action": "home"}')
        service.wait(lambda: len(service.rig.stage.moves) == 1)  # back to 0°, 0°
        assert other.ask("cmd/settings", action="get")["state"] == "idle"
        assert other.ask("cmd/stage", action="stop")["uncertainty"] is not None
        [reply] = far.replies()
        assert reply["error"]["code"] == "INVALID_STATE"
        assert "told to stop" in reply["error"]["message"]
        assert other.ask("cmd/stage", action="get")["pan"] is None
