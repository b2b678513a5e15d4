"""A device whose library hangs does not keep the service from ending, with its files whole."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import numpy as np
import pytest
from commanding import configuration
from scripted import SHAPE, ScriptedCamera, ScriptedStage
from test_commands import HastyClock

from drivers import Capabilities, Frame
from drivers.recording import Recording
from drivers.simulation.render import Truth
from service.capture.rig import Rig
from service.daemon.daemon import Daemon
from service.daemon.last_resort import last_resort
from service.daemon.run import run_service

pytestmark = pytest.mark.faults


class Hanging(ScriptedCamera):
    """From its sixth frame on it never comes back, until it is let go."""

    hangs, let_go = Flag(), Flag()

    def _grab(self, timeout: float) -> Frame:
        if self.calls >= 6:
            self.hangs.set()
            self.let_go.wait(60)
        return super()._grab(timeout)


def test_it_hands_over_and_ends_without_the_device(tmp_path: Path, endpoint: str) -> None:
    clock = HastyClock(1_700_000_000_000_000_000)
    camera = Hanging(clock)
    recording = {"enabled": True, "directory": str(tmp_path / "kept")}
    settings = configuration(tmp_path, endpoint, start="scan", recording=recording)
    ended, daemons = Flag(), list[Daemon]()

    def serve() -> None:
        run_service(
            settings,
            Rig(camera, ScriptedStage(clock), clock),
            started=daemons.append,
            abandoned=lambda _: ended.set(),
        )

    thread = Thread(target=serve, daemon=True)
    thread.start()
    try:
        assert camera.hangs.wait(120)
        daemons[0].stop.set()
        began = time.monotonic()
        assert ended.wait(30)
        assert 2.0 < time.monotonic() - began < 7
        [path] = (tmp_path / "kept").iterdir()
        assert (path.suffix, Recording(path).damage) == (".mcap", None)
    finally:
        camera.let_go.set()
        thread.join(30)
    assert not thread.is_alive()


class Opening(ScriptedCamera):
    """Takes its time, until it is let go."""

    opens, let_go = Flag(), Flag()

    def _open(self) -> None:
        self.opens.set()
        self.let_go.wait(60)
        super()._open()


class Rendering(ScriptedCamera):
    """Takes its time to render what is true, until it is let go."""

    opens, let_go = Flag(), Flag()

    def _capabilities(self) -> Capabilities:
        return replace(super()._capabilities(), source="simulation")

    def truth_renderer(self, upsampling: int) -> Callable[[], Truth]:
        return lambda: self._truth(upsampling)

    def _truth(self, upsampling: int) -> Truth:
        self.opens.set()
        self.let_go.wait(60)
        image = np.ones((upsampling * SHAPE[0], upsampling * SHAPE[1]), np.float32)
        return Truth(image, image, image)


@pytest.mark.parametrize("kind", [Opening, Rendering])
def test_a_device_that_is_being_opened_is_no_fault_and_costs_nothing(
    kind: type[Opening | Rendering], tmp_path: Path, endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    clock = HastyClock(1_700_000_000_000_000_000)
    camera = kind(clock)
    recording = {"enabled": True, "directory": str(tmp_path / "kept")}
    settings = configuration(tmp_path, endpoint, start="scan", recording=recording)
    ended, lost, daemons = Flag(), list[str](), list[Daemon]()

    def end(told: Sequence[str]) -> None:
        lost.extend(told)
        ended.set()

    def serve() -> None:
        rig = Rig(camera, ScriptedStage(clock), clock)
        run_service(settings, rig, started=daemons.append, abandoned=end)

    thread = Thread(target=serve, daemon=True)
    with caplog.at_level(logging.INFO):
        thread.start()
        try:
            assert camera.opens.wait(60)
            began = time.monotonic()
            daemons[0].stop.set()
            assert ended.wait(30)
            assert time.monotonic() - began < 7
            assert lost == []
            assert "told to stop before the devices were ready" in caplog.text
            assert "let go" not in caplog.text
        finally:
            camera.let_go.set()
            thread.join(30)
    assert not thread.is_alive()


def test_nobody_is_given_up_who_comes_back_in_time() -> None:
    stop, given_up = Flag(), Flag()
    with last_resort(stop, lambda: 2.5, given_up.set):
        stop.set()
        time.sleep(0.1)
    assert not given_up.wait(4.0)
