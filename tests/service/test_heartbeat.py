"""The status is told at once after a change, and no more often than it can be read."""

import time
from pathlib import Path
from threading import Event as Flag

from commanding import configuration, running
from test_commands import hasty_rig

from service.daemon.heartbeat import Heartbeat
from service.messages.events import StatusTold


def test_a_nudge_has_the_next_beat_come_now_and_a_flood_of_them_does_not_make_a_flood() -> None:
    beats: list[float] = []
    came = Flag()

    def beat() -> None:
        beats.append(time.monotonic())
        came.set()

    with Heartbeat(beat, 60.0) as heart:
        assert came.wait(30)
        came.clear()
        heart.nudge()
        assert came.wait(30), "it would have come after a minute"
        until, before = time.monotonic() + 1.0, len(beats)
        while time.monotonic() < until:
            heart.nudge()
            time.sleep(0.001)
        assert 1 <= len(beats) - before <= 11


def test_one_bad_beat_is_not_the_last() -> None:
    came = Flag()
    number = iter(range(3))

    def beat() -> None:
        if next(number) == 0:
            raise ValueError("bad")
        came.set()

    with Heartbeat(beat, 0.01):
        assert came.wait(30)


def test_one_that_hangs_is_left_behind() -> None:
    begun, let_go = Flag(), Flag()

    def beat() -> None:
        begun.set()
        let_go.wait(60)

    began = time.monotonic()
    with Heartbeat(beat, patience=0.1):
        assert begun.wait(30)
    assert time.monotonic() - began < 30
    let_go.set()


def test_what_is_degraded_is_in_the_status_without_waiting_for_its_second(
    tmp_path: Path, endpoint: str
) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service:
        assert service.daemon is not None
        states = service.daemon.states
        quickest = 60.0
        for _ in range(5):
            began = time.monotonic()
            for _ in range(2):
                states.degrade("test", "something is broken", "mend it")
                service.wait(lambda: bool(service.of(StatusTold)[-1].status.degraded))
                states.mend("test")
                service.wait(lambda: not service.of(StatusTold)[-1].status.degraded)
            quickest = min(quickest, time.monotonic() - began)
        assert quickest < 2.0, "once a second four changes would take more than two"
