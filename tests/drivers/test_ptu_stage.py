import re
from math import radians

import pytest
from emulators.ptu_emulator import PtuEmulator
from emulators.scripted_port import UNPLUGGED, Exchange, ScriptedPort

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    NotAvailableError,
    OperationError,
    StateError,
)
from drivers.stages.ptu import PtuStage

COUNT = radians(185.1428 / 3600)

HANDSHAKE: list[Exchange] = [
    (b" ", b""),
    (b"FT ", b"FT *\r\n"),  # echoed: it is on after power-up
    (b"ED ", b"ED *\r\n"),
    (b"CI ", b"*\r\n"),
    (b"I ", b"*\r\n"),
]
QUIET_HANDSHAKE: list[Exchange] = [(b" ", b""), *((sent, b"*\r\n") for sent, _ in HANDSHAKE[1:])]
GREETING: list[Exchange] = [
    *HANDSHAKE,
    (b"PR ", b"* 185.142800\r\n"),
    *QUIET_HANDSHAKE,
    (b"PP ", b"* 0\r\n"),
    (b"PR ", b"* 185.142800\r\n"),
    (b"PN ", b"* -3090\r\n"),
    (b"PX ", b"* 3090\r\n"),
    (b"PS ", b"* 1000\r\n"),
    (b"PA ", b"* 2000\r\n"),
    (b"TR ", b"* 185.142800\r\n"),
    (b"TN ", b"* -907\r\n"),
    (b"TX ", b"* 604\r\n"),
    (b"TS ", b"* 1000\r\n"),
    (b"TA ", b"* 2000\r\n"),
]
AT_ZERO: list[Exchange] = [(b"PP ", b"* 0\r\n"), (b"TP ", b"* 0\r\n")]
MOVE: list[Exchange] = [*AT_ZERO, (b"PP1000 ", b"*\r\n"), (b"TP-10 ", b"*\r\n")]
ARRIVED: list[Exchange] = [(b"PP ", b"* 1000\r\n"), (b"TP ", b"* -10\r\n")]


class Script:
    def __init__(self, monkeypatch):
        self._monkeypatch = monkeypatch
        self.clock = VirtualClock()

    def stage(self, *exchanges: Exchange, greeting=GREETING) -> PtuStage:
        self.port = ScriptedPort(self.clock, [*greeting, *exchanges])
        self._monkeypatch.setattr("serial.serial_for_url", self.port.open)
        stage = make_stage("ptu", {"port": "scripted"}, self.clock)
        stage.open()
        return stage


def keep_asking(stage):
    while True:
        _ = stage.position


@pytest.fixture
def script(monkeypatch):
    return Script(monkeypatch)


def test_learns_resolution_and_limits_from_the_unit(script):
    stage = script.stage()
    limits = stage.limits
    assert limits.pan == pytest.approx((-3090 * COUNT, 3090 * COUNT))
    assert limits.tilt == pytest.approx((-907 * COUNT, 604 * COUNT))
    assert stage.resolution == pytest.approx(COUNT)
    script.port.finish()


def test_moves_to_the_nearest_positions_and_confirms_them(script):
    stage = script.stage(*MOVE, (b"A ", [1.0, b"*\r\n"]), *ARRIVED, *ARRIVED)
    stage.move_to(1000.4 * COUNT, -9.6 * COUNT)
    stage.wait()
    assert stage.position.pan == pytest.approx(1000 * COUNT)  # positive: to the left
    script.port.finish()


def test_reads_positions_truly(script):
    stage = script.stage((b"PP ", b"* 17\r\n"), (b"TP ", b"* -3\r\n"))
    position = stage.position
    assert (position.pan, position.tilt) == pytest.approx((17 * COUNT, -3 * COUNT))
    script.port.finish()


@pytest.mark.parametrize(
    "reply",
    [
        b"* 1000\r",
        [b"*", 0.1, b" 10", 0.1, b"00", 0.1, b"\r\n"],
        [b"\xff\x00 ~*\x81\xfe* 1000\r\n"],
        [0.9, b"* 1000\r\n"],
        [b"*\r\n", b"* 1000\r\n"],
        [b"* 10\x8100\r\n"],  # asked again
        b"",  # asked again
        b"!\r\n",  # asked again
    ],
    ids=["cr", "partial", "noise", "delay", "late-star", "spoilt-number", "lost", "noise-refusal"],
)
def test_reads_a_position_over_a_bad_line(script, reply):
    repeated = [(b"PP ", b"* 1000\r\n")] if reply in (b"", b"!\r\n", [b"* 10\x8100\r\n"]) else []
    stage = script.stage((b"PP ", reply), *repeated, (b"TP ", b"* 0\r\n"))
    assert stage.position.pan == pytest.approx(1000 * COUNT)
    script.port.finish()


def test_accepts_a_unit_that_always_echoes_and_speaks_in_words(script):
    def wordy(exchange: Exchange) -> Exchange:
        sent, reply = exchange
        return sent, sent + bytes(reply).replace(b"* ", b"* Current value is ")

    stage = script.stage(*map(wordy, [*MOVE, (b"A ", b"*\r\n"), *ARRIVED]), greeting=map(wordy, GREETING))
    stage.move_to(1000 * COUNT, -10 * COUNT)
    stage.wait()
    script.port.finish()


def test_nothing_is_sent_for_an_angle_beyond_the_limits(script):
    stage = script.stage()
    with pytest.raises(LimitError, match=r"pan 160\.000° is outside"):
        stage.move_to(radians(160), 0.0)
    assert not stage.needs_home
    script.port.finish()


def test_still_moving_when_time_is_up_and_awaited_again(script):
    stage = script.stage(*MOVE, (b"A ", b""), (b"A ", [b"*\r\n", 0.1, b"*\r\n"]), *ARRIVED)
    stage.move_to(1000 * COUNT, -10 * COUNT)
    with pytest.raises(DeviceTimeoutError, match=r"still moving after 0\.5 s"):
        stage.wait(0.5)
    assert not stage.needs_home
    stage.wait()


def test_movement_that_does_not_arrive(script):
    stage = script.stage(*MOVE, (b"A ", b"*\r\n"), *[(b"PP ", b"* 900\r\n"), (b"TP ", b"* -10\r\n")] * 201)
    stage.move_to(1000 * COUNT, -10 * COUNT)
    with pytest.raises(DeviceTimeoutError, match=r"sent to positions .1000, -10. and stands at .900, -10."):
        stage.wait(10)


def test_unit_that_falls_silent_on_its_way_is_lost(script):
    stage = script.stage(*MOVE, (b"A ", b""), (b"PP ", b""), (b"PP ", b""))
    stage.move_to(1000 * COUNT, -10 * COUNT)
    with pytest.raises(DeviceLostError, match="does not answer 'PP'"):
        stage.wait(60)
    assert stage.needs_home
    with pytest.raises(StateError, match="its position is unknown"):
        _ = stage.position
    with pytest.raises(StateError, match="home it first"):
        stage.move_to(0.0, 0.0)
    script.port.finish()


def test_limit_hit_on_the_way_makes_the_position_unknown_until_homed(script):
    stage = script.stage(
        *MOVE,
        (b"A ", [0.2, b"!P", 0.1, b"*\r\n"]),
        (b" R ", [5.0, b"!T!T!P!P*"]),
        *QUIET_HANDSHAKE,
        *AT_ZERO,
        (b"PP0 ", b"*\r\n"),
        (b"TP0 ", b"*\r\n"),
        (b"A ", b"*\r\n"),
        *AT_ZERO,
        *AT_ZERO,
    )
    stage.move_to(1000 * COUNT, -10 * COUNT)
    with pytest.raises(LimitError, match="the pan axis hit a limit; steps are lost"):
        stage.wait()
    assert stage.needs_home
    stage.home()
    assert not stage.needs_home
    assert stage.position.pan == 0
    script.port.finish()


def test_limit_hit_unasked_is_noticed_at_the_next_call(script):
    stage = script.stage((b"PP ", b"* 0\r\n"), (b"TP ", b"* 0\r\n!T\r\n"))
    _ = stage.position
    with pytest.raises(LimitError, match="tilt axis hit a limit"):
        _ = stage.position
    assert stage.needs_home


def test_homing_without_an_end(script):
    stage = script.stage((b" R ", [1.0, b"!T!T"]))
    with pytest.raises(DeviceTimeoutError, match="no end of the calibration move within 60 s"):
        stage.home()
    assert stage.needs_home
    script.port.finish()


def test_restart_is_recognised_by_its_echo(script):
    echoed = (b"PP ", b"PP * 0\r\n")
    stage = script.stage(echoed, echoed)
    with pytest.raises(DeviceLostError, match="has restarted"):
        _ = stage.position
    assert stage.needs_home
    script.port.finish()


def test_echo_seen_once_is_noise(script):
    stage = script.stage((b"PP ", b"PP * 0\r\n"), (b"PP ", b"* 0\r\n"), (b"TP ", b"* 0\r\n"))
    assert stage.position.pan == 0
    script.port.finish()


def test_refusal_is_reported_with_the_unit_s_words(script):
    refused = (b"PP1000 ", b"! Maximum allowable pan position is 900\r\n")
    stage = script.stage(*AT_ZERO, refused, refused)
    with pytest.raises(OperationError, match="Maximum allowable pan position is 900"):
        stage.move_to(1000 * COUNT, 0.0)
    script.port.finish()


def test_unplugging_in_the_middle_of_a_movement(script):
    stage = script.stage(*MOVE, (b"A ", [0.1, UNPLUGGED]))
    stage.move_to(1000 * COUNT, -10 * COUNT)
    with pytest.raises(DeviceLostError, match="the serial line is gone"):
        stage.wait()
    assert stage.needs_home
    stage.close()
    script.port.finish()


def test_waits_for_a_unit_that_calibrates_itself(script):
    silent = [(sent, b"") for sent, _ in [*HANDSHAKE, (b"PR ", b"")]]
    late = [*HANDSHAKE, (b"PR ", b"!T!T!P!P* 185.142800\r\n* 185.142800\r\n")]
    script.stage(greeting=[*silent * 8, *late, *GREETING[6:]])
    script.port.finish()


def test_gives_up_on_a_silent_port_with_advice(script):
    silent = [(sent, b"") for sent, _ in [*HANDSHAKE, (b"PR ", b"")]]
    with pytest.raises(InitialisationError, match=r"no pan-tilt unit answers within 30 s.*baud"):
        script.stage(greeting=silent * 40)
    assert not script.port.is_open


def test_implausible_description_is_refused(script):
    greeting = [exchange if exchange[0] != b"PX " else (b"PX ", b"* -3090\r\n") for exchange in GREETING]
    with pytest.raises(InitialisationError, match="axis P implausibly"):
        script.stage(greeting=greeting)


def test_port_that_is_not_there():
    with pytest.raises(NotAvailableError, match="there is no such serial port"):
        make_stage("ptu", {"port": "/dev/no-such-port"}).open()


def test_emulated_unit_end_to_end():
    with PtuEmulator() as emulator, make_stage("ptu", {"port": emulator.port}) as stage:
        stage.move_to(radians(10), radians(-5))
        stage.wait()
        assert stage.position.pan == pytest.approx(radians(10), abs=COUNT / 2)
        assert stage.position.tilt == pytest.approx(radians(-5), abs=COUNT / 2)
        emulator.run_into_limit("T")
        with pytest.raises(LimitError):
            keep_asking(stage)
        stage.home()
        assert stage.position.pan == 0
        forbidden = re.compile("D[SRF]|U.*|_.*|L[ED]")
        assert not [command for command in emulator.commands if forbidden.fullmatch(command)]


def test_emulated_unit_loses_power_and_is_recovered():
    with PtuEmulator(boot_seconds=0.5) as emulator:
        stage = make_stage("ptu", {"port": emulator.port})
        with stage:
            stage.move_to(radians(20), 0.0)
            stage.wait()
            emulator.power_cycle()
            with pytest.raises(DeviceLostError):
                keep_asking(stage)
        stage.open()
        assert stage.needs_home
        stage.home()
        assert stage.position.pan == 0
        stage.close()


def test_emulated_unit_is_unplugged_and_replugged(tmp_path):
    with PtuEmulator(tmp_path / "ptu") as emulator:
        stage = make_stage("ptu", {"port": emulator.port})
        stage.open()
        emulator.unplug()
        with pytest.raises(DeviceLostError, match="the serial line is gone"):
            stage.move_to(radians(1), 0.0)
        stage.close()
        with pytest.raises(NotAvailableError):
            stage.open()
        emulator.plug()
        stage.open()
        assert stage.needs_home
        stage.home()
        stage.close()
