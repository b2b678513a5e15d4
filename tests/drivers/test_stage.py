"""What the base of all stages promises: limits, stopping, positions that are not known."""

from math import nan, radians

import pytest

from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    MotionStoppedError,
    OperationError,
    StateError,
)
from drivers.motion import MotionOptions, duration
from drivers.position import Limits, Position
from drivers.stage import Stage


class Turntable(Stage):
    """Moves evenly in virtual time and writes down what it is made to do; the next poll raises `fault`."""

    Options = MotionOptions

    def __init__(self, options=None, own=((-2.0, 2.0), (-1.0, 1.0))):
        super().__init__(options, VirtualClock())
        self.did, self.fault, self.stop_fault, self.blocked = [], None, None, False
        self.here, self._path, self._own = Position(0.0, 0.0), None, own

    def _open(self): ...
    def _close(self): ...

    def _home(self):
        self.did.append("home")

    def _homing(self):
        return "turns to 0°, 0°"

    def _move_to(self, pan, tilt):
        self.did.append((pan, tilt))
        distance = max(abs(pan - self.here.pan), abs(tilt - self.here.tilt))
        seconds = duration(distance, self._speed(), self._acceleration())
        self._path = Position(pan, tilt), self.clock.now() + round(seconds * 1e9)

    def _remaining(self):
        if self.fault is not None:
            raise self.fault
        if self._path is None:
            return 0.0
        target, end = self._path
        if self.blocked or self.clock.now() < end:
            return 0.1
        self.here, self._path = target, None
        return 0.0

    def _stop(self):
        self.did.append("stop")
        if self.stop_fault is not None:
            raise self.stop_fault
        self._path = None

    def _position(self):
        return self.here

    def _limits(self):
        return Limits(*self._own)


@pytest.fixture
def stage():
    made = Turntable()
    made.open()
    return made


def after(stage, seconds):
    """A predicate that becomes true when so much of the stage's time has passed."""
    end = stage.clock.now() + round(seconds * 1e9)
    return lambda: stage.clock.now() >= end


def test_opening_moves_nothing(stage):
    assert stage.did == []
    assert stage.uncertainty is None


def test_it_is_slow_unless_told_otherwise(stage):
    assert stage.speed == pytest.approx(radians(10))
    stage.move_to(radians(20), 0.0)
    stage.wait()
    assert stage.clock.now() / 1e9 == pytest.approx(2.0 + 0.5, abs=0.11)


def test_limits_of_the_host_and_of_the_stage_both_hold():
    options = MotionOptions(pan_limits=(-10, 200), tilt_limits=(-90, 20))
    stage = Turntable(options)
    stage.open()
    assert stage.limits == Limits((radians(-10), 2.0), (-1.0, radians(20)))
    for pan, tilt in [(radians(-11), 0.0), (2.1, 0.0), (0.0, radians(21)), (0.0, nan)]:
        with pytest.raises(LimitError, match="nothing was sent"):
            stage.move_to(pan, tilt)
    assert stage.did == []
    assert stage.uncertainty is None


@pytest.mark.parametrize("limits", [(5, 10), (-10, -5), (10, -10), (0, 0), (-400, 0), (0, nan)])
def test_limits_without_zero_are_refused(limits):
    with pytest.raises(ValueError, match="pan_limits"):
        MotionOptions(pan_limits=limits)


def test_a_stage_whose_own_limits_exclude_zero_is_refused():
    stage = Turntable(own=((0.5, 1.0), (-1.0, 1.0)))
    with pytest.raises(InitialisationError, match=r"pan may turn from 28\.648° to 57\.296°, without 0°"):
        stage.open()
    assert not stage.is_open


def test_a_report_beyond_the_limits_is_no_position(stage):
    stage.here = Position(radians(361), 0.0)
    with pytest.raises(LimitError, match=r"reports that pan 361\.000° is outside.*count of its turns"):
        _ = stage.position
    assert "361" in stage.uncertainty
    with pytest.raises(StateError, match="home it first"):
        stage.move_to(0.0, 0.0)
    assert stage.did == [], "a stage that has lost count must not unwind"


def test_it_is_not_moved_from_beyond_the_limits(stage):
    stage.here = Position(radians(-350), 0.0)
    with pytest.raises(LimitError):
        stage.move_to(0.0, 0.0)
    assert stage.did == []


def test_interruption_stops_it_on_its_way(stage):
    stage.move_to(1.0, 0.0)
    stage.interrupted = after(stage, 1.0)
    began = stage.clock.now()
    with pytest.raises(MotionStoppedError):
        stage.wait()
    assert stage.did == [(1.0, 0.0), "stop"]
    assert stage.clock.now() - began <= 1.05e9
    assert stage.uncertainty is None, "where it stopped is known"


def test_interrupted_beforehand_it_does_not_even_start(stage):
    stage.interrupted = lambda: True
    for move in (lambda: stage.move_to(1.0, 0.0), stage.home):
        with pytest.raises(MotionStoppedError):
            move()
    assert stage.did == []


def test_homing_is_stopped_too_and_leaves_the_position_unknown(stage):
    stage.here = Position(1.0, 0.0)
    stage.interrupted = after(stage, 1.0)
    with pytest.raises(MotionStoppedError):
        stage.home()
    assert stage.did[-1] == "stop"
    assert stage.uncertainty == "homing did not come to its end"


@pytest.mark.parametrize(
    ("fault", "unknown"),
    [
        (OperationError("refused"), False),
        (KeyboardInterrupt(), False),
        (ZeroDivisionError(), False),
        (LimitError("ran into a switch"), True),
        (DeviceLostError("gone"), True),
    ],
)
def test_any_failure_of_a_movement_stops_it(stage, fault, unknown):
    stage.move_to(1.0, 0.0)
    stage.fault = fault
    with pytest.raises(type(fault)):
        stage.wait()
    assert stage.did == [(1.0, 0.0), "stop"]
    assert stage.needs_home == unknown


def test_a_blocked_movement_is_stopped_in_time(stage):
    stage.blocked = True
    stage.move_to(radians(20), 0.0)
    with pytest.raises(DeviceTimeoutError, match="not at its target 3 s after"):
        stage.wait(3.0)
    assert stage.clock.now() / 1e9 == pytest.approx(2.5 + 3.0, abs=0.05)
    assert stage.did[-1] == "stop"


def test_what_cannot_be_stopped_for_certain_is_unknown(stage, caplog):
    stage.move_to(1.0, 0.0)
    stage.fault = OperationError("refused")
    stage.stop_fault = OperationError("no answer to the halt")
    with pytest.raises(OperationError, match="refused"):
        stage.wait()
    assert "could not be stopped for certain: no answer to the halt" in stage.uncertainty
    assert "no answer to the halt" in caplog.text
    with pytest.raises(OperationError, match="no answer to the halt"):
        stage.stop()


def test_closing_stops_what_still_moves(stage):
    stage.move_to(1.0, 0.0)
    stage.close()
    stage.close()
    assert stage.did == [(1.0, 0.0), "stop"]


def test_homing_makes_an_unknown_position_known(stage):
    stage.fault = DeviceLostError("gone")
    stage.move_to(1.0, 0.0)
    with pytest.raises(DeviceLostError):
        stage.wait()
    stage.close()
    stage.open()
    assert stage.uncertainty == "gone", "opening again mends no position"
    stage.fault = None
    stage.home()
    assert stage.uncertainty is None
    assert stage.did[-2:] == ["home", (0.0, 0.0)]
