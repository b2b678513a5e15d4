"""The configuration is read again while the service runs."""

from pathlib import Path
from typing import Any

import pytest
from commanding import Running, configuration, running, stranger
from scripted import ScriptedCamera, ScriptedStage
from test_commands import HastyClock

from drivers.settings import CameraSettings
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon import reloading
from service.daemon.reloading import Reloading
from service.errors import ConfigurationError, PlanError
from service.messages.events import MapFused


@pytest.fixture(autouse=True)
def _no_real_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reloading, "check_options", lambda _: None)


def hasty_rig() -> Rig:
    clock = HastyClock(1_700_000_000_000_000_000)
    return Rig(ScriptedCamera(clock), ScriptedStage(clock), clock)


def changed(before: Configuration, **sections: dict[str, Any]) -> Configuration:
    """A configuration with some fields of some sections changed."""
    update = {name: getattr(before, name).model_copy(update=fields) for name, fields in sections.items()}
    return before.model_copy(update=update)


def reload(service: Running, wanted: Configuration) -> None:
    assert service.daemon is not None
    Reloading(service.daemon, lambda: wanted).reload()


def test_what_has_changed_is_in_force_with_the_next_burst_and_what_was_commanded_is_dropped(
    tmp_path: Path, endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    settings = configuration(tmp_path, endpoint, start="scan")
    caplog.set_level("INFO")
    with running(settings, hasty_rig(), "scanning") as service, stranger(endpoint) as far:
        daemon = service.daemon
        assert daemon is not None
        found = daemon.rig.camera.settings.integration_time
        far.ask("cmd/settings", action="set", integration_time=0.01)
        far.ask("cmd/fusion", action="set", method="bicubic", fill=1)
        service.wait(lambda: any(event.map.report.method == "bicubic" for event in service.of(MapFused)))
        wanted = changed(
            settings,
            plan={"span": 3.0},
            fusion={"executor": "cluster", "cluster": "tcp://10.0.0.7:8786"},
            zenoh={"prefix": "other/rig"},
            camera={"timeout": 5.0},
        ).model_copy(update={"start": "idle"})
        reload(service, wanted)
        assert daemon.configuration.plan.span == 3.0
        assert daemon.configuration.fusion == settings.fusion
        assert daemon.configuration.zenoh.prefix == settings.zenoh.prefix
        assert daemon.rig.camera.settings.integration_time == found
        assert daemon.grabber.timeout == 5.0
        before = len(service.of(MapFused))
        service.wait(lambda: len(service.of(MapFused)) > before + 2)
        assert service.of(MapFused)[-1].map.report.method == "nearest"
        assert daemon.states.state == "scanning"
    said = next(line for line in caplog.messages if "was reloaded" in line)
    assert "plan.span" in said
    assert "fusion.method" in said
    assert said.endswith("needs a restart: start, fusion.executor, fusion.cluster, zenoh.prefix")


def test_an_error_changes_nothing_and_says_so(tmp_path: Path, endpoint: str) -> None:
    settings = configuration(tmp_path, endpoint)
    with running(settings, hasty_rig()) as service:
        daemon = service.daemon
        assert daemon is not None
        wanted = changed(
            settings, plan={"pan": 100.0}, camera={"settings": CameraSettings(integration_time=0.005)}
        )
        before = daemon.configuration, daemon.rig.camera.settings
        with pytest.raises(PlanError):  # out of the stage's reach
            reload(service, wanted)
        assert (daemon.configuration, daemon.rig.camera.settings) == before

        def unreadable() -> Configuration:
            raise ConfigurationError("rig.toml: plan.sapn: unknown; did you mean plan.span?")

        Reloading(daemon, unreadable).begin()
        service.wait(lambda: bool(daemon.states.degraded))
        [fault] = daemon.states.degraded
        assert "did you mean plan.span?" in fault.what
        assert daemon.configuration is before[0]
        Reloading(daemon, lambda: settings).begin()
        service.wait(lambda: not daemon.states.degraded)


def test_the_recorder_follows(tmp_path: Path, endpoint: str) -> None:
    folder = {"directory": tmp_path / "kept"}
    settings = configuration(tmp_path, endpoint, recording={"directory": str(tmp_path / "kept")})
    with running(settings, hasty_rig()) as service, stranger(endpoint) as far:
        assert far.ask("cmd/record", action="list")["recorder"]["recording"] is False
        wanted = changed(settings, recording={**folder, "enabled": True})
        reload(service, wanted)
        far.ask("cmd/scan", action="once")
        recorder = far.ask("cmd/record", action="list")["recorder"]
        assert recorder["recording"]
        elsewhere = changed(wanted, recording={"directory": tmp_path / "elsewhere"})
        reload(service, elsewhere)
        far.ask("cmd/scan", action="once")
        assert Path(far.ask("cmd/record", action="list")["recorder"]["file"]).parent.name == "elsewhere"
        reload(service, changed(elsewhere, recording={"enabled": False}))
        far.ask("cmd/scan", action="once")
        assert far.ask("cmd/record", action="list")["recorder"]["recording"] is False
    assert {path.suffix for path in (tmp_path / "kept").iterdir()} == {".mcap"}
