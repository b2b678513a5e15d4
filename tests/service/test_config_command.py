"""`lidarboost config`, and what a wrong configuration is answered."""

import json
from pathlib import Path

import pytest
from typed import lidarboost

pytestmark = pytest.mark.usefixtures("typing_settings")


def test_an_unknown_key_is_status_2(tmp_path: Path, small: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text('[fusion]\nmetod = "area"\n')
    for words in (("run", config, "--replay", small, "--once"), ("config", "check", config)):
        result = lidarboost(*words)
        assert result.exit_code == 2
        (line,) = result.stderr.splitlines()
        assert line == f"error: {config}: unknown key fusion.metod; did you mean fusion.method?"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[camera]\nbackend = "simulatd"', "camera.backend = 'simulatd'"),
        ('[camera]\nbackend = "simulated"\n[camera.options]\nscen = "plane"', "camera.options"),
        ('[stage]\nbackend = "simulated"\n[stage.options]\nspeeed = 1', "stage.options"),
        ('[camera]\ncalibration = "nowhere.toml"', "camera.calibration: nowhere.toml"),
        ('[sinks.x]\nkind = "nowhere"', "sinks.x.kind = 'nowhere'"),
        ('[sinks.x]\nkind = "service.sinks.summaries:Summaries"\noptions.a = 1', "sinks.x.options: a"),
    ],
)
def test_the_options_of_backends_are_checked_too(tmp_path: Path, text: str, said: str) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(text)
    result = lidarboost("config", "check", config)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert said in line


def test_config_check_shows_what_is_in_force_and_schema_is_json() -> None:
    result = lidarboost("config", "check", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["fusion"]["method"] == "nearest"
    assert "fusion" in json.loads(lidarboost("config", "schema").stdout)["properties"]
