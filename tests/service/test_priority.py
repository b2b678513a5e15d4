"""Whoever waits for a frame goes first where the system permits it, and nowhere else."""

import os
import sys
from threading import get_native_id

import pytest
from scripted import ScriptedCamera, ScriptedStage

from drivers import Frame
from drivers.clock import VirtualClock
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.priority import Foremost
from service.capture.rig import Rig

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads have no priorities of their own")

Call = tuple[int, int, int]


class Watched(ScriptedCamera):
    """Knows how many changes of the priority there were when a frame was asked for."""

    calls_before: int
    made: list[Call]

    def _grab(self, timeout: float) -> Frame:
        self.calls_before = len(self.made)
        return super()._grab(timeout)


def test_a_thread_goes_first_while_it_waits_for_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Call] = []
    monkeypatch.setattr(os, "setpriority", lambda *call: made.append(call))
    monkeypatch.setattr(os, "getpriority", lambda *_: 3)
    clock = VirtualClock(0)
    camera = Watched(clock)
    camera.made = made
    rig = Rig(camera, ScriptedStage(clock), clock)
    rig.open()
    Grabber(rig, 1.0, Control()).grab()
    rig.close()
    thread = get_native_id()
    assert made == [(os.PRIO_PROCESS, thread, -7), (os.PRIO_PROCESS, thread, 3)]
    assert camera.calls_before == 1


def test_what_is_refused_is_not_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Call] = []

    def refuse(*call: int) -> None:
        asked.append(call)  # type: ignore[arg-type]
        raise PermissionError

    monkeypatch.setattr(os, "setpriority", refuse)
    foremost = Foremost()
    for _ in range(3):
        with foremost:
            pass
    assert (len(asked), foremost.is_permitted) == (1, False)


def test_the_priority_is_the_former_one_after_an_error() -> None:
    before = os.getpriority(os.PRIO_PROCESS, get_native_id())
    foremost = Foremost()
    within = _priority_of_failing(foremost)
    assert within == (max(-20, before - 10) if foremost.is_permitted else before)
    assert os.getpriority(os.PRIO_PROCESS, get_native_id()) == before


def _priority_of_failing(foremost: Foremost) -> int:
    try:
        with foremost:
            priority = os.getpriority(os.PRIO_PROCESS, get_native_id())
            raise KeyError
    except KeyError:
        return priority
