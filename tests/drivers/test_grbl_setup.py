"""A Grbl controller when it is opened: what it is asked, and what is refused with its remedy."""

from math import radians

import pytest
from emulators.virtual_line import Fault
from grbl_rig import STEP, GrblRig

from drivers.errors import (
    InitialisationError,
    StateError,
)


@pytest.fixture
def rig(monkeypatch):
    return GrblRig(monkeypatch)


@pytest.mark.parametrize("homing", [False, True])
def test_opening_asks_and_moves_nothing(rig, homing):
    rig.fit(homing)
    stage = rig.stage()
    assert set(rig.grbl.commands) <= {"$$", "$I", "$N", "$G", "$"}
    assert not any(set(data) & set(b"\x18!~\x85") for _, data in rig.line.writes)
    assert stage.needs_home
    assert stage.uncertainty == "Grbl may have been moved or reset before its port was opened"
    assert stage.limits.pan == pytest.approx((radians(-90), radians(90)))
    assert stage.limits.tilt == pytest.approx((radians(-45), radians(45)))
    for action in (lambda: stage.move_to(0.0, 0.0), stage.wait, lambda: stage.position):
        with pytest.raises(StateError, match="home it first"):
            action()
    assert not rig.grbl.moves


def test_a_board_that_opening_does_not_reset_is_left_as_it_is(rig):
    rig.grbl.resets_on_opening = False
    rig.stage()
    assert not any(b"\x18" in data for _, data in rig.line.writes)


def test_a_board_in_the_middle_of_something_is_refused(rig):
    rig.grbl.resets_on_opening = False
    rig.grbl.run_program(X=80.0)
    with pytest.raises(InitialisationError, match=r"state Run, in the middle of something"):
        rig.stage()


def test_a_board_that_an_alarm_has_silenced_is_reset(rig):
    rig.grbl.resets_on_opening = False
    rig.grbl.hit_limit()
    assert rig.stage().needs_home


def test_silent_port_is_refused_with_advice(rig):
    rig.grbl.mute = True
    with pytest.raises(InitialisationError, match=r"no Grbl controller answers.*115200"):
        rig.stage()


def test_other_version_is_refused(rig):
    rig.grbl.build_info = b"[0.9j.20160316:]\r\n"
    with pytest.raises(InitialisationError, match=r"no Grbl 1\.1 .*0\.9j"):
        rig.stage()


@pytest.mark.parametrize(
    ("number", "value", "said"),
    [
        (13, "1", r"reports inches \(\$13=1\); set \$13=0"),
        (10, "2", r"work positions \(\$10=2\); set \$10=1"),
        (1, "25", r"motors let go between movements \(\$1=25\); set \$1=255"),
        (100, "0", r"axis X has no steps per degree \(\$100=0\)"),
        (111, "0", r"axis Y has no degrees per minute \(\$111=0\)"),
        (121, "50", r"axis Y accelerates by 50°/s², .*\(\$121=50\); set \$121=20"),
        (130, "0", r"axis X has no travel \(\$130=0\)"),
    ],
)
def test_settings_that_would_make_it_wrong_are_refused_with_the_remedy(rig, number, value, said):
    rig.grbl.settings[number] = value
    with pytest.raises(InitialisationError, match=said):
        rig.stage()


def test_homing_faster_than_allowed_is_refused(rig):
    rig.fit(homing=True)
    rig.grbl.settings[25] = "2400"
    with pytest.raises(InitialisationError, match=r"homes at 40°/s.*set \$25=600"):
        rig.stage()


def test_a_startup_line_that_moves_is_refused(rig):
    rig.grbl.startup = ["G54", "G0X10"]
    with pytest.raises(InitialisationError, match=r"moves by itself at each start \(\$N1=G0X10\)"):
        rig.stage()
    rig.grbl.startup = ["G20G54G17", ""]
    rig.stage()


@pytest.mark.parametrize("before", [5, 6])
def test_a_setting_that_noise_has_spoilt_is_not_believed(rig, before):
    spoilt = b"".join(f"${key}={at}\r\n".encode() for key, at in rig.grbl.settings.items())
    spoilt = spoilt.replace(b"$100=160.000", b"$100=169.000") + b"ok\r\n"
    rig.line.spoil([None] * before + [Fault("garbled", pieces=(spoilt,))])
    assert rig.stage().resolution == pytest.approx(STEP)
    assert rig.grbl.commands.count("$$") > 2


@pytest.mark.parametrize(
    ("options", "said"),
    [({"pan_axis": "Y"}, "pan_axis and tilt_axis are both Y"), ({"pan_zero": 10.0}, "leave out pan_zero")],
)
def test_options_that_cannot_be_are_refused(rig, options, said):
    with pytest.raises(InitialisationError, match=said):
        rig.stage(**options)
