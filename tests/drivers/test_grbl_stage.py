from math import radians

import pytest
from emulators.grbl_emulator import GrblEmulator
from emulators.scripted_port import UNPLUGGED, Exchange, ScriptedPort

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    OperationError,
    StateError,
)
from drivers.stages.grbl_messages import parse_status

STEP = radians(1 / 160)
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
SETTINGS = b"$20=0\r\n$22=0\r\n$23=0\r\n$100=160.000\r\n$101=160.000\r\n$130=180.000\r\n$131=90.000\r\nok\r\n"
MODES = (b"G21 G90 G94\n", b"ok\r\n")


def idle(x: float, y: float = 0.0) -> bytes:
    return f"<Idle|MPos:{x:.3f},{y:.3f},0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n".encode()


GREETING: list[Exchange] = [(b"$$\n", SETTINGS), (b"?", idle(0)), MODES]
HOMED_GREETING: list[Exchange] = [
    (b"$$\n", SETTINGS.replace(b"$22=0", b"$22=1")),
    (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
]
MOVE: Exchange = (b"G53 G0 X30.0000\n", b"ok\r\n")
RUN: Exchange = (b"?", b"<Run|MPos:10.000,0.000,0.000|FS:3600,0>\r\n")
THERE: Exchange = (b"?", idle(30))


class Script:
    def __init__(self, monkeypatch):
        self._monkeypatch = monkeypatch
        self.clock = VirtualClock()

    def stage(self, *exchanges: Exchange, greeting=GREETING, banner=(1.5, BANNER), **options):
        self.port = ScriptedPort(self.clock, [*greeting, *exchanges], banner)
        self._monkeypatch.setattr("serial.serial_for_url", self.port.open)
        stage = make_stage("grbl", {"port": "scripted", **options}, self.clock)
        stage.open()
        return stage


@pytest.fixture
def script(monkeypatch):
    return Script(monkeypatch)


def test_waits_for_the_banner_and_takes_the_limits_from_the_travel(script):
    limits = script.stage(
        banner=[1.0, b"\x00\xf8garbage\r\n", 1.0, b"\r\nGrbl 1.1", 0.2, b"f ['$']\r\n"]
    ).limits
    assert limits.pan == pytest.approx((radians(-90), radians(90)))
    assert limits.tilt == (0.0, 0.0)
    script.port.finish()


def test_resets_a_board_that_opening_does_not_reset(script):
    script.stage(banner=(), greeting=[(b"\x18", [0.1, BANNER]), *GREETING])
    assert script.clock.now() > 3e9
    script.port.finish()


def test_silent_port_is_refused_with_advice(script):
    with pytest.raises(InitialisationError, match=r"no Grbl controller answers.*115200"):
        script.stage(banner=(), greeting=[(b"\x18", b"")])
    assert not script.port.is_open


def test_other_version_is_refused(script):
    with pytest.raises(InitialisationError, match=r"this is Grbl 0\.9; version 1\.1 is needed"):
        script.stage(banner=(b"Grbl 0.9j ['$' for help]\r\n",), greeting=[])


def test_resolution_is_that_of_the_coarser_axis(script):
    coarse = (b"$$\n", SETTINGS.replace(b"$101=160", b"$101=10"))
    stage = script.stage(greeting=[coarse, *GREETING[1:]], tilt_axis="Y")
    assert stage.resolution == pytest.approx(radians(0.1))


def test_moves_and_waits_for_two_idle_reports_at_the_target(script):
    early_idle = (b"?", idle(0))
    stage = script.stage(MOVE, early_idle, RUN, THERE, THERE, THERE)
    stage.move_to(radians(30), 0.0)
    before = script.clock.now()
    stage.wait()
    assert script.clock.now() - before == pytest.approx(0.6e9), "polled five times a second"
    assert stage.position.pan == pytest.approx(radians(30))
    script.port.finish()


def test_two_axes_with_their_signs_and_zeros(script):
    stage = script.stage(
        (b"G53 G0 X-20.0000 Y15.0000\n", b"ok\r\n"),
        (b"?", idle(-20, 15)),
        (b"?", idle(-20, 15)),
        (b"?", idle(-20, 15)),
        tilt_axis="Y",
        pan_sign=-1,
        pan_zero=10.0,
        tilt_zero=5.0,
        pan_limits=(-45, 45),
    )
    assert stage.limits.pan == (radians(-45), radians(45))
    assert stage.limits.tilt == pytest.approx((radians(-50), radians(40)))
    stage.move_to(radians(30), radians(10))
    stage.wait()
    position = stage.position
    assert (position.pan, position.tilt) == pytest.approx((radians(30), radians(10)))
    script.port.finish()


def test_rounds_to_whole_steps_and_reports_them(script):
    near = round(10.003 * 160) / 160
    stage = script.stage(
        (f"G53 G0 X{near:.4f}\n".encode(), b"ok\r\n"),
        (b"?", idle(near)),
        (b"?", idle(near)),
        (b"?", idle(near)),
    )
    stage.move_to(radians(10.003), 0.0)
    stage.wait()
    pan = stage.position.pan
    assert pan == pytest.approx(radians(near), abs=1e-12)
    assert abs(pan - radians(10.003)) <= STEP / 2


@pytest.mark.parametrize(
    ("reply", "repeated"),
    [
        ([b"<Idle|MPos:3", 0.1, b"0.000,0.000,", 0.3, b"0.000|FS:0,0>\r\n"], False),
        (b"\xff\x80?<Idle|MPos:30.000,0.000,0.000|FS:0,0>\n", False),
        (b"[MSG:Pgm End]\r\n<Idle|WPos:25.000,0.000,0.000|WCO:5.000,0.000,0.000>\r\n", False),
        (b"<Idle|MPos:30.\x8100,0.000,0.000|FS:0,0>\r\n", True),
        (b"", True),
    ],
    ids=["partial", "noise-and-echo", "work-position", "spoilt", "lost"],
)
def test_reads_a_status_over_a_bad_line(script, reply, repeated):
    stage = script.stage((b"?", reply), *([THERE] if repeated else []))
    assert stage.position.pan == pytest.approx(radians(30))
    script.port.finish()


def test_line_spoilt_by_noise_is_sent_again(script):
    stage = script.stage((MOVE[0], b"error:2\r\n"), (MOVE[0], b"G53 G0 X30.0000\r\n\xfeok\r\n"))
    stage.move_to(radians(30), 0.0)
    script.port.finish()


def test_refusal_says_what_it_means(script):
    stage = script.stage((MOVE[0], b"error:20\r\n"), (MOVE[0], b"error:20\r\n"))
    with pytest.raises(OperationError, match=r"error:20 \(unsupported command\)"):
        stage.move_to(radians(30), 0.0)
    assert not stage.needs_home


def test_nothing_is_sent_for_an_angle_beyond_the_limits(script):
    stage = script.stage()
    with pytest.raises(LimitError, match="nothing was sent"):
        stage.move_to(radians(90.1), 0.0)
    with pytest.raises(LimitError, match=r"tilt 1\.000°"):
        stage.move_to(0.0, radians(1))
    assert not stage.needs_home
    script.port.finish()


def test_limits_beyond_the_travel_are_refused(script):
    with pytest.raises(InitialisationError, match=r"axis X cannot have limits -100° to 100°.*\$130=180"):
        script.stage(pan_limits=(-100, 100))


def test_missing_travel_is_refused(script):
    greeting = [(b"$$\n", SETTINGS.replace(b"$130=180", b"$130=0"))]
    with pytest.raises(InitialisationError, match=r"\$130"):
        script.stage(greeting=greeting)


def test_not_there_in_time(script):
    stage = script.stage(MOVE, *[RUN] * 7)
    stage.move_to(radians(30), 0.0)
    with pytest.raises(DeviceTimeoutError, match=r"Run at 10\.000°"):
        stage.wait(1.0)
    assert not stage.needs_home


def test_alarm_on_the_way_locks_until_homed(script):
    stage = script.stage(
        MOVE,
        (b"?", b"ALARM:1\r\n[MSG:Reset to continue]\r\n"),
        (b"\x18", [0.1, b"ALARM:3\r\n" + BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"]),
        (b"$X\n", b"[MSG:Caution: Unlocked]\r\nok\r\n"),
        MODES,
        (b"G53 G0 X0.0000\n", b"ok\r\n"),
        (b"?", idle(0)),
        (b"?", idle(0)),
    )
    stage.move_to(radians(30), 0.0)
    with pytest.raises(LimitError, match="ALARM:1, a hard limit switch was hit; home it"):
        stage.wait()
    with pytest.raises(StateError, match="home it first"):
        stage.move_to(0.0, 0.0)
    stage.home()
    assert not stage.needs_home
    script.port.finish()


@pytest.mark.parametrize(
    "exchange", [(b"?", b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"), (MOVE[0], b"error:9\r\n")]
)
def test_alarm_whose_message_was_lost_is_noticed(script, exchange):
    exchanges = [MOVE, exchange] if exchange[0] == b"?" else [exchange, exchange]
    stage = script.stage(*exchanges)
    with pytest.raises(LimitError):
        go(stage, radians(30))
    assert stage.needs_home
    script.port.finish()


def test_restart_is_noticed(script):
    stage = script.stage(MOVE, RUN, (b"?", [0.05, BANNER]))
    stage.move_to(radians(30), 0.0)
    with pytest.raises(DeviceLostError, match="has restarted"):
        stage.wait()
    assert stage.needs_home


def test_silence_and_unplugging(script):
    stage = script.stage(*[(b"?", b"")] * 3)
    with pytest.raises(DeviceLostError, match="does not answer"):
        _ = stage.position
    stage = script.stage(MOVE, (b"?", [UNPLUGGED]))
    stage.move_to(radians(30), 0.0)
    with pytest.raises(DeviceLostError, match="serial line is gone"):
        stage.wait()
    assert stage.needs_home


def test_with_switches_it_has_to_be_homed_first(script):
    stage = script.stage(
        (b"\x18", BANNER),
        (b"$H\n", [20.0, b"ok\r\n"]),
        MODES,
        (b"G53 G0 X-90.0000\n", b"ok\r\n"),
        (b"?", idle(-90)),
        (b"?", idle(-90)),
        greeting=HOMED_GREETING,
    )
    assert stage.limits.pan == pytest.approx((radians(-90), radians(90)))
    with pytest.raises(StateError, match="reset when its port was opened"):
        stage.move_to(0.0, 0.0)
    stage.home()
    assert not stage.needs_home
    script.port.finish()


def test_origin_at_the_switch_where_grbl_is_built_so(script):
    greeting = [
        (b"$$\n", SETTINGS.replace(b"$22=0", b"$22=1").replace(b"$23=0", b"$23=1")),
        (b"$I\n", b"[OPT:VZ,15,128]\r\nok\r\n"),
    ]
    stage = script.stage(
        (b"\x18", BANNER),
        (b"$H\n", b"ok\r\n"),
        MODES,
        (b"G53 G0 X90.0000\n", b"ok\r\n"),
        (b"?", idle(90)),
        (b"?", idle(90)),
        greeting=greeting,
    )
    stage.home()
    script.port.finish()


def test_failed_homing_leaves_the_position_unknown(script):
    stage = script.stage((b"\x18", BANNER), (b"$H\n", [3.0, b"ALARM:9\r\n"]), greeting=HOMED_GREETING)
    with pytest.raises(LimitError, match="homing did not find the limit switch"):
        stage.home()
    assert stage.needs_home


def test_status_reports():
    status = parse_status("<Hold:0|MPos:1.5,-2,0|FS:0,0|Ov:100,100,100>")
    assert status is not None
    assert (status.state, status.machine) == ("Hold", (1.5, -2.0, 0.0))
    assert parse_status("<Idle|MPos:1.5,-2") is None
    assert parse_status("ok") is None


def test_emulated_controller_end_to_end():
    with GrblEmulator() as emulator:
        options = {"port": emulator.port, "tilt_axis": "Y"}
        with make_stage("grbl", options) as stage:
            stage.move_to(radians(12.3), radians(-4))
            stage.wait()
            assert stage.position.pan == pytest.approx(radians(12.3), abs=STEP / 2)
            assert stage.position.tilt == pytest.approx(radians(-4), abs=STEP / 2)
            emulator.hit_limit()
            with pytest.raises(LimitError):
                keep_asking(stage)
            stage.home()
            assert stage.position.pan == pytest.approx(0.0, abs=STEP / 2)
            emulator.restart()
            with pytest.raises(DeviceLostError):
                keep_asking(stage)
        assert all(line[:1] != "$" or line in ("$$", "$I", "$X", "$H") for line in emulator.commands)


def test_emulated_controller_with_switches_is_unplugged_and_replugged(tmp_path):
    with GrblEmulator(tmp_path / "grbl", homing=True) as emulator:
        stage = make_stage("grbl", {"port": emulator.port})
        stage.open()
        stage.home()
        assert stage.position.pan == pytest.approx(0.0, abs=STEP / 2)
        emulator.unplug()
        with pytest.raises(DeviceLostError):
            stage.move_to(radians(1), 0.0)
        stage.close()
        emulator.plug()
        stage.open()
        stage.home()
        stage.close()


def go(stage, pan):
    stage.move_to(pan, 0.0)
    stage.wait()


def keep_asking(stage):
    while True:
        _ = stage.position
