"""Grbl and Dynamixel through any order of use and faults: no wrong angle, no step too far, none unasked."""

from contextlib import suppress
from math import degrees, radians
from unittest.mock import patch

import pytest
from emulators.dynamixel_emulator import VirtualDynamixels
from emulators.grbl_emulator import VirtualGrbl
from emulators.virtual_line import DOUBLED, LOST
from hypothesis import example, given, settings
from hypothesis import strategies as st

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import DriverError, StateError

PAN, TILT = 40.0, 15.0
LIMITS = {"pan_limits": (-PAN, PAN), "tilt_limits": (-TILT, TILT)}
COUNT = 360 / 4096


class GrblRig:
    """Two axes on a Grbl, and the person who looks after them."""

    name, options = "grbl", {"tilt_axis": "Y"}
    step = 1 / 160
    slack = 1e-3

    def __init__(self, clock, homing):
        self.device = VirtualGrbl(clock, homing=homing)

    @property
    def true(self):
        return self.device.true["X"], self.device.true["Y"]

    @property
    def moving(self):
        return self.device.moving or self.device.state == "Home"

    @property
    def targets(self):
        return [(at["X"], at["Y"]) for at in self.device.targets]

    def make_ready(self):
        """Without switches somebody has to turn the axes to 0° before they are declared to be there."""
        if self.device.settings[22] == "0" and not self.moving:
            self.device.turn_by_hand(X=0.0, Y=0.0)

    def break_down(self):
        self.device.hit_limit()

    def lose_power(self):
        self.device.restart()


class DynamixelRig:
    """Two servos, of which the first counts turns."""

    name, options = "dynamixel", {"tilt_id": 2, "pan_zero": 100}
    step = COUNT
    slack = 4 * COUNT

    def __init__(self, clock, homing):
        self.device = VirtualDynamixels(clock)
        self.device.servos[1].mode = 4 if homing else 3
        self._zeros = {1: 100.0, 2: 2048.0}
        if not homing:
            self.options = {"tilt_id": 2}
            self._zeros[1] = 2048.0
        for number, servo in self.device.servos.items():
            servo.turn_by_hand(self._zeros[number])
            servo.power_up()

    @property
    def true(self):
        return tuple((servo.true - self._zeros[n]) * COUNT for n, servo in self.device.servos.items())

    @property
    def moving(self):
        return any(servo.moving for servo in self.device.servos.values())

    @property
    def targets(self):
        goals = [[(at - self._zeros[n]) * COUNT for n, at in self.device.goals if n == one] for one in (1, 2)]
        length = max(map(len, goals))
        return list(zip(*([0.0] * (length - len(found)) + found for found in goals), strict=True))

    def make_ready(self):
        for servo in self.device.servos.values():
            servo.hardware_error = 0

    def break_down(self):
        self.device.servos[1].shut_down(0x20)

    def lose_power(self):
        self.device.power_cycle()
        self.device.servos[1].turn_by_hand(self.device.servos[1].true + 30)


RIGS = [(GrblRig, False), (GrblRig, True), (DynamixelRig, False), (DynamixelRig, True)]

faults = st.sampled_from([LOST, DOUBLED, 0.15, 0.5, 1.16, 3.5, None])
angles = st.tuples(st.floats(-1.3, 1.3), st.floats(-1.3, 1.3))
steps = st.one_of(
    st.tuples(st.just("move"), angles),
    st.tuples(st.just("move"), angles),
    st.tuples(st.sampled_from(["wait", "position", "stop", "home", "reopen"]), st.none()),
    st.tuples(st.just("sleep"), st.floats(0, 3)),
    st.tuples(st.just("line"), st.lists(faults, min_size=1, max_size=5)),
    st.tuples(st.sampled_from(["break down", "lose power", "unplug", "interrupt"]), st.none()),
)


TOUR = [
    ("reopen", None),
    ("home", None),
    ("move", (0.08, -0.1)),
    ("wait", None),
    ("position", None),
    ("move", (-0.2, 0.1)),
    ("sleep", 0.2),
    ("stop", None),
    ("position", None),
    ("move", (-0.02, 0.05)),
    ("wait", None),
    ("position", None),
]


class Use:
    """One stage in use; checks after each step."""

    def __init__(self, rig, homing):
        self.clock = VirtualClock()
        self.rig = rig(self.clock, homing)
        options = {"port": "virtual", **LIMITS, **self.rig.options}
        self.stage = make_stage(self.rig.name, options, self.clock)
        self._interrupted = False
        self.stage.interrupted = lambda: self._interrupted

    def take(self, step, argument):
        before = len(self.rig.targets)
        with suppress(DriverError):
            self._do(step, argument)
        if step not in ("interrupt", "line"):
            self._interrupted = False
        self._check_targets(before, asked=step in ("move", "home"))

    def _do(self, step, argument):
        if step == "move":
            self.stage.move_to(radians(argument[0] * PAN), radians(argument[1] * TILT))
        elif step == "wait":
            self.stage.wait(2.0)
        elif step == "position":
            self.check_position()
        elif step == "stop":
            self.stage.stop()
            assert not self.rig.moving
        elif step == "home":
            self.rig.make_ready()
            self.stage.home()
        elif step == "reopen":
            self.stage.close()
            self.rig.device.plugged = True
            with patch("serial.serial_for_url", self.rig.device.open):
                self.stage.open()
        elif step == "sleep":
            self.clock.sleep(argument)
            self.rig.device.run()
        elif step == "line":
            self.rig.device.faults.extend(argument)
        elif step == "break down":
            self.rig.break_down()
        elif step == "lose power":
            self.rig.lose_power()
        elif step == "unplug":
            self.rig.device.plugged = False
        elif step == "interrupt":
            self._interrupted = True

    def check_position(self):
        moving, true = self.rig.moving, self.rig.true
        found = self.stage.position
        if moving or self.rig.moving:
            assert abs(degrees(found.pan)) <= PAN + 0.5
            assert abs(degrees(found.tilt)) <= TILT + 0.5
        else:
            assert (degrees(found.pan), degrees(found.tilt)) == pytest.approx(true, abs=self.rig.step)

    def through(self):
        """A homing and three movements; how often something was refused."""
        trouble = 0
        self.first_of_each_kind = []
        for step, argument in TOUR:
            begin = len(self.rig.device.answered)
            try:
                self._do(step, argument)
            except StateError:
                assert self.stage.uncertainty or not self.stage.is_open, "refused without a reason"
            except DriverError:
                trouble += 1
            found = first_of_each(self.rig.device.answered[begin:])
            self.first_of_each_kind += [begin + number for number in found]
        return trouble

    def _check_targets(self, before, asked):
        new = self.rig.targets[before:]
        for pan, tilt in new:
            assert abs(pan) <= PAN + self.rig.slack, "sent beyond its limits"
            assert abs(tilt) <= TILT + self.rig.slack, "sent beyond its limits"
        if not asked and self.rig.name == "grbl":
            assert not new, "moved without consent"


@pytest.mark.parametrize(("rig", "homing"), RIGS)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(plan=st.lists(steps, min_size=3, max_size=14))
@example(
    plan=[("home", None), ("move", (1.0, 1.0)), ("line", [1.16]), ("position", None), ("position", None)]
)
def test_no_wrong_angle_and_no_movement_too_far_or_unasked(rig, homing, plan):
    use = Use(rig, homing)
    for step, argument in [("reopen", None), ("home", None), *plan, ("position", None)]:
        use.take(step, argument)


@pytest.mark.parametrize("fault", [LOST, DOUBLED, 0.15, 1.16, 3.5])
@pytest.mark.parametrize(("rig", "homing"), RIGS)
def test_any_one_answer_late_doubled_or_lost(rig, homing, fault):
    plain = Use(rig, homing)
    assert plain.through() == 0
    for number in plain.first_of_each_kind:
        use = Use(rig, homing)
        use.rig.device.faults.extend([None] * number + [fault])
        use.through()


def first_of_each(answered):
    """Numbers of the answers to the first and the last question of each kind."""
    last = {question: number for number, question in enumerate(answered)}
    first = {question: number for number, question in reversed(list(enumerate(answered)))}
    return sorted({*first.values(), *last.values()})
