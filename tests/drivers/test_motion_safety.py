"""No fault of line or device ever leads to a motion unasked for, beyond the limits, or to a wrong angle."""

from __future__ import annotations

from math import degrees, radians
from unittest.mock import patch

import pytest
from emulators.virtual_line import Fault, VirtualLine
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_worlds import WORLDS, MotionWorld

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import DriverError, LimitError, MotionStoppedError

PAN, TILT = 20.0, 15.0
"""Limits of the host, degrees."""

HALT_SECONDS = 0.2
START = 1_000_000_000

FAULTS = [Fault("lost"), *[Fault("late", s) for s in (0.3, 1.16, 2.5)]]
FAULTS += [Fault("twice", s) for s in (0.0, 0.015, 0.3, 1.16)]


class Session:
    """A stage and its device in virtual time, watched at every step."""

    def __init__(self, world: MotionWorld, faults=()) -> None:
        self.world, self.clock = world, VirtualClock(START)
        self.device = world.device()
        self.line = VirtualLine(self.device, self.clock, dict(faults))
        options = {"pan_limits": (-PAN, PAN), "tilt_limits": (-TILT, TILT), **world.options}
        self.stage = make_stage(world.backend, {"port": "virtual", **options}, self.clock)

    def __enter__(self):
        self._patch = patch("serial.serial_for_url", self.line.open)
        self._patch.start()
        return self

    def __exit__(self, *_):
        self._patch.stop()

    @property
    def truth(self):
        return tuple(degrees(angle) for angle in self.device.true_angles)

    def open(self):
        self._unmoved(self.stage.open)

    def reopen(self):
        self._unmoved(self.stage.close)
        self._unmoved(self.stage.open)

    def home(self):
        self.world.before_home(self.device)
        self._moves(self.stage.home)
        self._agrees(0.0, 0.0)

    def move(self, pan, tilt):
        self._moves(lambda: self.stage.move_to(radians(pan), radians(tilt)))

    def wait(self, cut=None):
        """Until it has arrived, or is interrupted after `cut` seconds; it stands in any case then."""
        began, moved = self.clock.now(), self.device.moving
        if cut is not None:
            self.stage.interrupted = lambda: self.clock.now() - began > cut * 1e9
        try:
            self._unmoved(self.stage.wait)
        except MotionStoppedError:
            halts = [at for at in self.device.halts if at >= began * 1e-9]
            if moved and halts:  # else it stood, or has arrived meanwhile
                assert halts[0] - began * 1e-9 - cut <= HALT_SECONDS
            raise
        finally:
            self.stage.interrupted = lambda: False
            assert not self.device.moving or not self.stage.is_open, "a wait that has ended leaves it moving"

    def stop(self):
        self._unmoved(self.stage.stop)
        assert not self.device.moving

    def position(self):
        moved = self.device.moving
        found = self._unmoved(lambda: self.stage.position)
        if not moved:
            self._agrees(degrees(found.pan), degrees(found.tilt))

    def befall(self, accident):
        self.world.accidents[accident](self.device)

    def let_pass(self, seconds):
        self.clock.sleep(seconds)

    def try_(self, step, *arguments):
        """One step, which may fail in a way that the driver declares."""
        try:
            getattr(self, step)(*arguments)
        except DriverError:
            return False
        return True

    def _agrees(self, pan, tilt):
        slack = degrees(self.world.tolerance) + degrees(self.stage.resolution)
        assert self.truth == pytest.approx((pan, tilt), abs=slack), "a wrong angle is reported as known"

    def _unmoved(self, call):
        before = len(self.device.moves)
        try:
            return call()
        finally:
            assert self.device.moves[before:] == [], "it was set in motion by something that must not"

    def _moves(self, call):
        before, slack = len(self.device.moves), degrees(self.world.tolerance) + 0.1
        try:
            call()
        finally:
            for pan, tilt in self.device.moves[before:]:
                assert abs(degrees(pan)) <= PAN + slack, "sent beyond the limits of pan"
                assert abs(degrees(tilt)) <= TILT + slack, "sent beyond the limits of tilt"


def ready(session):
    """Open, and homed with consent where the stage asks for it."""
    session.open()
    if session.stage.needs_home:
        session.home()


@pytest.fixture(params=sorted(WORLDS))
def world(request):
    return WORLDS[request.param]


def test_opening_moves_nothing(world):
    with Session(world) as session:
        session.open()
        session.let_pass(2.0)
        session.reopen()
        assert session.device.moves == []
        assert not session.device.moving


def test_an_interruption_in_mid_move_halts_it_at_once(world):
    with Session(world) as session:
        ready(session)
        session.move(15, 10)
        with pytest.raises(MotionStoppedError):
            session.wait(cut=0.5)
        assert not session.device.moving
        assert session.truth[0] < 12
        if not session.stage.needs_home:
            session.position()


@pytest.mark.parametrize("beyond", [(PAN + 1, 0), (0, -TILT - 1)])
def test_nothing_is_sent_beyond_the_limits(world, beyond):
    with Session(world) as session:
        ready(session)
        before = len(session.device.moves)
        with pytest.raises(LimitError, match="nothing was sent"):
            session.move(*beyond)
        assert len(session.device.moves) == before


def test_it_is_no_faster_than_it_may_be(world):
    with Session(world) as session:
        ready(session)
        began = session.clock.now()
        session.move(15, 0)
        session.wait()
        assert session.truth[0] == pytest.approx(15, abs=0.2)
        assert (session.clock.now() - began) / 1e9 > 15 / session.stage.options.speed


def test_after_an_accident_it_moves_only_once_homed(world):
    for accident in world.accidents:
        with Session(world) as session:
            ready(session)
            session.move(10, -5)
            session.wait()
            session.befall(accident)
            session.let_pass(0.2)
            if session.try_("position"):
                continue  # it lost nothing
            for _ in range(2):
                assert session.stage.needs_home, accident
                for step in (("move", 0, 0), ("wait",), ("position",)):
                    assert not session.try_(*step)
                session.reopen()
            session.home()
            session.move(5, 5)
            session.wait()
            session.position()


def errand(session):
    """A few poses, whose angles are right or said to be unknown; whether all went well."""
    ready(session)
    for pan, tilt in ((5, -3), (-4, 8), (5, -3)):
        session.move(pan, tilt)
        session.wait()
        here = session.stage.position
        slack = session.world.tolerance + session.stage.resolution
        assert (here.pan, here.tilt) == pytest.approx((radians(pan), radians(tilt)), abs=slack)
        assert (here.pan, here.tilt) == pytest.approx(session.device.true_angles, abs=slack)
    session.stop()


def answers_of_an_errand(world):
    with Session(world) as session:
        errand(session)
        return session.line.answers


def test_each_answer_lost_late_or_doubled_gives_right_angles_or_an_error(world):
    failed = 0
    for number in range(0, answers_of_an_errand(world), 2):  # what matters is asked twice
        fault = FAULTS[number // 2 % len(FAULTS)]
        with Session(world, {number: fault}) as session:
            try:
                errand(session)
            except DriverError:
                failed += 1
    assert failed == 0, "a single lost, late or doubled answer is mended"


ACCIDENT_OR_STEP = st.one_of(
    st.tuples(st.just("move"), st.integers(-20, 20), st.integers(-15, 15)),
    st.tuples(st.just("move"), st.integers(-30, 30), st.integers(-30, 30)),
    st.just(("wait",)),
    st.tuples(st.just("wait"), st.floats(0.0, 2.0)),
    st.just(("position",)),
    st.just(("stop",)),
    st.just(("reopen",)),
    st.just(("home",)),
    st.tuples(st.just("let_pass"), st.floats(0.0, 2.0)),
    st.tuples(st.just("befall"), st.integers(0, 9)),
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    steps=st.lists(ACCIDENT_OR_STEP, min_size=3, max_size=12),
    faults=st.dictionaries(st.integers(0, 150), st.sampled_from(FAULTS), max_size=6),
)
@pytest.mark.parametrize("name", sorted(WORLDS))
def test_no_sequence_of_faults_is_dangerous(name, steps, faults):
    world = WORLDS[name]
    accidents = sorted(world.accidents)
    with Session(world, faults) as session:
        session.try_("open")
        for step, *arguments in steps:
            if step == "befall":
                session.befall(accidents[arguments[0] % len(accidents)])
            elif session.stage.is_open or step == "reopen":
                session.try_(step, *arguments)
        session.stage.close()
        assert not session.device.moving
