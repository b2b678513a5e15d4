"""Consent: what is announced, when a stage may be homed, and what is final."""

from __future__ import annotations

import json
import logging
import os
import pty
from contextlib import contextmanager
from math import radians

import pytest
from scripted import ScriptedStage
from typer.testing import CliRunner

from drivers import DeviceLostError, DeviceTimeoutError, LimitError, MotionStoppedError, Position
from drivers.backends import STAGES
from drivers.clock import Clock, VirtualClock
from drivers.device import BackendOptions
from service.capture.motion import Motion, Operator
from service.cli import app
from service.cli.operator import TerminalOperator, with_consent
from service.config.sections import Configuration, StageSection
from service.errors import MotionError

POSES = (Position(radians(1.0), 0.0), Position(radians(-2.0), radians(3.0)))


class RealStage(ScriptedStage):
    """One that somebody could be hit by, and that does not know where it is."""

    needs_consent = True

    def __init__(self, known: bool = False) -> None:
        super().__init__(VirtualClock())
        if not known:
            self._declare_unknown("its port was reset")
        self.open()

    def lose(self) -> None:
        self._declare_unknown("it lost its power")


class Person(Operator):
    def __init__(self, consents: bool = False) -> None:
        self.consents = consents
        self.told: list[str] = []
        self.asked: list[str] = []

    def tell(self, what: str) -> None:
        self.told.append(what)

    def ask(self, question: str, interrupted: object) -> bool:  # noqa: ARG002
        self.asked.append(question)
        return self.consents


def test_what_moves_how_far_and_how_fast_is_said_before_it_moves_and_once() -> None:
    stage, person = RealStage(known=True), Person()
    motion = Motion(stage, "ask", person)
    motion.prepare(POSES)
    assert stage.moves == []
    (said,) = person.told
    assert "from pan 0.00°, tilt 0.00° to pan -2.00° to 1.00°, tilt 0.00° to 3.00°, at most 5729.6°/s" in said
    motion.go(POSES[0], 1.0)
    motion.prepare(POSES)
    assert len(person.told) == 1
    assert person.asked == []


def test_an_unknown_position_is_asked_for_and_homing_announced() -> None:
    stage, person = RealStage(), Person(consents=True)
    Motion(stage, "ask", person).prepare(POSES)
    assert "its port was reset" in person.asked[0]
    assert person.told[0].startswith("homing RealStage: it moves nothing")
    assert stage.homings == 1


@pytest.mark.parametrize("home", ["ask", "never"])
def test_without_consent_it_stands_still_and_says_what_to_do(home) -> None:
    stage, person = RealStage(), Person()
    for _ in range(2):
        with pytest.raises(MotionError, match=r"its port was reset.*--home"):
            Motion(stage, home, person).prepare(POSES)
    assert stage.homings == 0
    assert stage.moves == []
    assert person.asked == [] if home == "never" else person.asked


def test_configured_consent_holds_for_the_start_and_two_more_times() -> None:
    stage = RealStage()
    motion = Motion(stage, "at start", Person())
    for _ in range(3):
        motion.prepare(POSES)
        stage.lose()
    with pytest.raises(MotionError, match="homed 3 times already"):
        motion.prepare(POSES)
    assert stage.homings == 3


def test_what_stands_anywhere_is_not_taken_for_zero_by_configuration() -> None:
    """A stage without switches, reset again and again, would walk away with its zero."""

    class WithoutSwitches(RealStage):
        finds_reference = False

    stage, nobody = WithoutSwitches(), Person()
    with pytest.raises(MotionError, match="starting again with --home; it then"):
        Motion(stage, "at start", nobody).prepare(POSES)
    assert stage.homings == 0
    Motion(stage, "at start", Person(consents=True)).prepare(POSES)
    assert stage.homings == 1


def test_a_simulated_stage_needs_no_consent() -> None:
    class SimulatedOne(RealStage):
        needs_consent = False

    stage, person = SimulatedOne(), Person()
    Motion(stage, "never", person).prepare(POSES)
    assert stage.homings == 1
    assert person.asked == []


def test_homing_that_fails_is_not_tried_again() -> None:
    stage = RealStage()

    def fail() -> None:
        stage.homings += 1
        raise DeviceTimeoutError("no switch found")

    stage._home = fail  # type: ignore[method-assign]
    motion = Motion(stage, "at start", Person())
    with pytest.raises(MotionError, match="no switch found"):
        motion.prepare(POSES)
    assert stage.homings == 1


def test_after_a_limit_configured_consent_is_not_enough() -> None:
    stage, person = RealStage(known=True), Person()
    motion = Motion(stage, "at start", person)
    stage.faults = {0: LimitError("ran into its limit")}
    with pytest.raises(MotionError, match="ran into its limit"):
        motion.go(POSES[0], 1.0)
    with pytest.raises(MotionError, match="--home"):
        motion.prepare(POSES)
    person.consents = True
    motion.prepare(POSES)
    assert stage.homings == 1


def test_a_lost_stage_is_no_verdict() -> None:
    stage = RealStage(known=True)
    stage.faults = {0: DeviceLostError("unplugged")}
    with pytest.raises(DeviceLostError):
        Motion(stage, "ask", Person()).go(POSES[0], 1.0)


def test_home_on_the_command_line_is_consent_to_one_homing() -> None:
    operator = TerminalOperator(home=True)
    assert operator.ask("May it?", lambda: False)
    assert not operator.ask("May it?", lambda: False)


def test_home_on_the_command_line_overrides_never() -> None:
    never = Configuration(stage=StageSection(home="never"))
    assert with_consent(never, True).stage.home == "ask"
    assert with_consent(never, False).stage.home == "never"
    at_start = Configuration(stage=StageSection(home="at start"))
    assert with_consent(at_start, True).stage.home == "at start"


@contextmanager
def terminal(monkeypatch):
    """A terminal that a person types on; gives the end to type at."""
    person, program = pty.openpty()
    with os.fdopen(program, "r") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        monkeypatch.setattr("sys.stderr.isatty", lambda: True)
        yield person
    os.close(person)


@pytest.mark.parametrize(("answer", "consents"), [(b"y\n", True), (b"\n", False), (b"yonder\n", False)])
def test_an_answer_on_the_terminal_is_consent(monkeypatch, capsys, answer, consents) -> None:
    with terminal(monkeypatch) as person:
        os.write(person, answer)
        assert TerminalOperator(home=False).ask("May it?", lambda: False) == consents
    assert "May it?" in capsys.readouterr().err


def test_waiting_for_an_answer_can_be_interrupted(monkeypatch) -> None:
    with terminal(monkeypatch):
        assert not TerminalOperator(home=False).ask("May it?", lambda: True)


def test_without_a_terminal_nobody_consents(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert not TerminalOperator(home=False).ask("May it?", lambda: False)


@pytest.mark.parametrize("sees_log", [False, True])
def test_announcements_are_logged_and_seen(caplog, capsys, sees_log) -> None:
    with caplog.at_level(logging.INFO):
        TerminalOperator(home=False, sees_log=sees_log).tell("it turns")
    assert "it turns" in caplog.text
    assert ("it turns" in capsys.readouterr().err) != sees_log


class NeedyStage(RealStage):
    """As backend `needy`."""

    def __init__(self, _options: BackendOptions, clock: Clock) -> None:
        ScriptedStage.__init__(self, clock)  # type: ignore[arg-type]
        self._declare_unknown("its port was reset")


@pytest.fixture
def needy(monkeypatch, tmp_path):
    """What `lidarboost` runs with: a simulated camera on a stage that does not know where it is."""
    monkeypatch.setitem(STAGES, "needy", (__name__, "NeedyStage"))
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    config = tmp_path / "rig.toml"
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": ["tcp/127.0.0.1:0"]}}))
    config.write_text(
        f"""
        camera = {{ backend = "simulated", options = {{ scene = "plane" }} }}
        stage.backend = "needy"
        fusion = {{ method = "nearest", register_poses = false, frames = 2, upsampling = 2 }}
        zenoh.config = "{zenoh}"
        """
    )
    return config


def lidarboost(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words], prog_name="lidarboost")


def test_one_pass_without_consent_fails_in_one_line_that_says_how_to_give_it(needy) -> None:
    result = lidarboost("run", needy, "--once")
    assert result.exit_code == 1
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error:")]
    assert "its port was reset" in line
    assert "--home" in line


def test_one_pass_with_home_homes_and_announces_what_moves(needy) -> None:
    result = lidarboost("run", needy, "--once", "--home")
    assert result.exit_code == 0, result.stderr
    assert "homing NeedyStage: it moves nothing" in result.stderr
    assert "is about to turn from pan 0.00°" in result.stderr


def test_commands_that_turn_nothing_do_not_even_open_the_stage(needy, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(NeedyStage, "_open", lambda self: pytest.fail("opened"))  # noqa: ARG005
    assert lidarboost("capture", "-c", needy, "-n", 2, "-o", tmp_path / "look.mcap").exit_code == 0
    assert lidarboost("hz", "-c", needy, "--seconds", 0.5).exit_code == 0


@pytest.mark.parametrize(("words", "status"), [((), 0), (("--once",), 130)])
def test_stopped_while_the_stage_is_opened_it_ends_as_told(needy, monkeypatch, words, status) -> None:
    def interrupted(_self: NeedyStage) -> None:
        raise MotionStoppedError("told to stop")

    monkeypatch.setattr(NeedyStage, "_open", interrupted)
    assert lidarboost("run", needy, *words).exit_code == status


def test_calibrating_the_mount_asks_for_consent_too(needy, tmp_path) -> None:
    output = tmp_path / "mount.toml"
    refused = lidarboost("calibrate", "mount", "-c", needy, "-o", output, "--repeats", 1)
    assert refused.exit_code == 1
    assert "--home" in refused.stderr
