"""Presets: ordinary settings under those that are given."""

import os
from pathlib import Path
from typing import get_args

import pytest
from scripted import ScriptedCamera, ScriptedStage
from typer.testing import CliRunner

from drivers.clock import VirtualClock
from drivers.settings import CameraSettings
from service.capture.rig import Rig
from service.cli import app
from service.config.file import load
from service.config.presets import DESCRIPTIONS, PRESETS, settings_of
from service.config.sections import Preset
from service.errors import ConfigurationError


@pytest.fixture(autouse=True)
def _no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.startswith("LIDARBOOST_"):
            monkeypatch.delenv(name)


def test_every_name_has_its_settings() -> None:
    assert set(get_args(Preset)) == set(PRESETS) == set(DESCRIPTIONS)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_they_are_in_force(name: str) -> None:
    found = load(None, {"preset": name}).model_dump()
    for key, value in settings_of(name):
        used = found
        for part in key.split("."):
            used = used[part]
        assert used == value


def test_what_is_explicit_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('preset = "fine"\n[fusion]\nframes = 5\n[camera.settings]\nframe_rate = 3.0\n')
    monkeypatch.setenv("LIDARBOOST_FUSION__UPSAMPLING", "3")
    found = load(path, {"fusion": {"tolerance": 0.01}})
    assert (found.fusion.frames, found.fusion.upsampling, found.fusion.tolerance) == (5, 3, 0.01)
    assert found.camera.settings is not None
    assert found.camera.settings.model_fields_set == {"frame_rate", "integration_time"}
    monkeypatch.setenv("LIDARBOOST_PRESET", "fast")
    assert load(path).fusion.method == "lidarboost"
    assert load(path, {"preset": "dark"}).fusion.fill == 8.0


def test_a_name_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="preset = 'nice'"):
        load(None, {"preset": "nice"})


def test_settings_that_are_not_named_stay_as_the_camera_has_them() -> None:
    class Fixed(ScriptedCamera):
        def _open(self) -> None:
            super()._open()
            self._settings = CameraSettings(modulation_frequency=30e6)

    clock = VirtualClock(10**18)
    camera = Fixed(clock)
    settings = load(None, {"preset": "fast"}).camera.settings
    rig = Rig(camera, ScriptedStage(clock), clock, settings=settings)
    rig.open()
    assert (camera.settings.modulation_frequency, camera.settings.integration_time) == (30e6, 0.005)


def test_what_they_set_is_printed() -> None:
    said = CliRunner().invoke(app, ["config", "presets"]).stdout
    assert "preset fast: camera.settings.integration_time = 0.005, fusion.frames = 8" in said
    assert len(said.splitlines()) == len(PRESETS)
    words = ["fuse", "nowhere.mcap", "--preset", "dark", "--upsampling", "4"]
    errors = CliRunner().invoke(app, words).stderr
    assert "fusion.upsampling = 2 (stays 4: set explicitly), fusion.amplitude_threshold = 0.0" in errors
