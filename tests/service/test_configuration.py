"""The configuration: layers, and what is said of mistakes in them."""

import os
from pathlib import Path

import pytest

from drivers import InitialisationError, make_camera, make_stage
from service.config.file import load
from service.config.schema import schema
from service.config.sections import Configuration, FusionSettings
from service.errors import ConfigurationError


@pytest.fixture(autouse=True)
def _no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.startswith("LIDARBOOST_"):
            monkeypatch.delenv(name)


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_without_anything_the_defaults_hold() -> None:
    assert load() == Configuration()
    assert Configuration().fusion.upsampling == 4


def test_file_then_environment_then_flags(write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write('[fusion]\nmethod = "nearest"\nframes = 7\nupsampling = 2\n')
    monkeypatch.setenv("LIDARBOOST_FUSION__METHOD", "area")
    monkeypatch.setenv("LIDARBOOST_FUSION__FRAMES", "8")
    found = load(path, {"fusion": {"frames": 9}})
    assert (found.fusion.method, found.fusion.frames, found.fusion.upsampling) == ("area", 9, 2)


def test_options_of_a_backend_come_from_the_environment_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIDARBOOST_CAMERA__OPTIONS__SCENE", "objects")
    assert load(None, {"camera": {"options": {"seed": 4}}}).camera.options == {"scene": "objects", "seed": 4}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[fusion]\nmetod = "area"', "unknown key fusion.metod; did you mean fusion.method?"),
        ("[fuson]\na = 1", "unknown key fuson; did you mean fusion?"),
        (
            "[camera.settings]\nintegration_tim = 3",
            "unknown key camera.settings.integration_tim; did you mean camera.settings.integration_time?",
        ),
        ("[stage]\nxyzzy = 1", "unknown key stage.xyzzy; known here: backend, options"),
        ("[fusion]\ntimeout = 1e-9", "fusion.timeout = 1e-09: Input should be greater than or equal to 1"),
        ("[fusion]\nframes = 0", "fusion.frames = 0: Input should be greater than or equal to 1"),
        ("[fusion]\nregularization = -1.0", "fusion.regularization = -1.0"),
        ('[zenoh]\nprefix = "a//b"', "zenoh.prefix = 'a//b'"),
        ("[fusion\n", "not valid TOML"),
    ],
)
def test_a_mistake_in_the_file_is_named_with_file_and_key(write, text: str, said: str) -> None:
    path = write(text)
    with pytest.raises(ConfigurationError) as caught:
        load(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_mistake_is_named_once(write) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load(write('[fusion]\nframes = 0\nregularization = "x"\nmetod = 1'))
    assert str(caught.value).count("fusion.regularization") == 1
    assert str(caught.value).count(";") >= 2


def test_a_byte_order_mark_before_the_file_is_no_statement(write) -> None:
    path = write('\ufeff[fusion]\nmethod = "nearest"\n')
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    assert load(path).fusion.method == "nearest"


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.toml: cannot read the configuration"):
        load(tmp_path / "nowhere.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        load(binary)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (
            "LIDARBOOST_FUSION__METHOD",
            "areaa",
            "environment variable LIDARBOOST_FUSION__METHOD: fusion.method",
        ),
        ("LIDARBOOST_FUSION__METOD", "area", "unknown key fusion.metod; did you mean fusion.method?"),
        ("LIDARBOOST_FUSON__METHOD", "area", "did you mean LIDARBOOST_FUSION__METHOD?"),
        ("LIDARBOOST_FUSION_FRAMES", "7", "did you mean LIDARBOOST_FUSION__FRAMES?"),
        ("LIDARBOOST_XYZZY", "7", "known here: LIDARBOOST_START, LIDARBOOST_PRESET, LIDARBOOST_CAMERA"),
        ("LIDARBOOST_FUSION", "area", "environment"),
    ],
)
def test_a_mistake_in_the_environment_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, said: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(ConfigurationError) as caught:
        load()
    assert said in str(caught.value)


def test_a_mistake_in_a_flag_is_the_command_lines() -> None:
    with pytest.raises(ConfigurationError, match=r"command line: fusion\.upsampling = 'q'"):
        load(None, {"fusion": {"upsampling": "q"}})


def test_every_field_says_what_it_means_and_every_number_is_bounded() -> None:
    found = schema()
    sections = [part for name, part in found["$defs"].items() if name.endswith("Section")]
    # All but `start` and `preset` are sections; of `sinks` there may be any number.
    assert len(sections) == len(Configuration.model_fields) - 2
    options = [part for name, part in found["$defs"].items() if "Options." in name]
    assert len(options) == 11
    for section in [*sections, *options]:
        for name, field in section.get("properties", {}).items():
            assert field.get("description"), f"{section['title']}.{name} says nothing"
            for choice in field.get("anyOf", [field]):
                if choice.get("type") in ("number", "integer"):
                    named = f"{section['title']}.{name}"
                    assert {"minimum", "exclusiveMinimum", "enum"} & choice.keys(), named
                    assert {"maximum", "exclusiveMaximum", "enum"} & choice.keys(), named


def test_the_schema_holds_the_options_of_the_backend_that_is_named() -> None:
    found = schema()
    stage = found["$defs"]["StageSection"]
    (ptu,) = [one for one in stage["allOf"] if one["if"]["properties"]["backend"]["const"] == "ptu"]
    assert ptu["then"]["properties"]["options"] == {"$ref": "#/$defs/StageOptions.ptu"}
    options = found["$defs"]["StageOptions.ptu"]
    assert options["required"] == ["port"]
    assert options["properties"]["baud_rate"]["maximum"] == 4_500_000
    assert "degrees" in options["properties"]["pan_limits"]["description"]


def test_a_wrong_option_names_the_valid_ones_and_a_value_its_bounds() -> None:
    with pytest.raises(InitialisationError, match=r"'ptu': .*it knows: .*port, baud_rate"):
        make_stage("ptu", {"prt": "/dev/ttyUSB0"})
    with pytest.raises(
        InitialisationError, match="speed: Input should be less than or equal to 1000"
    ) as said:
        make_camera("replay", {"path": "x.mcap", "speed": 2000})
    assert "it knows" not in str(said.value)
    with pytest.raises(InitialisationError, match="it knows: none"):
        make_stage("none", {"port": "x"})


def test_a_cluster_needs_its_address_and_is_set_by_no_command(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text('[fusion]\nexecutor = "cluster"\n')
    with pytest.raises(ConfigurationError, match="needs the address of its scheduler"):
        load(file)
    file.write_text('[fusion]\nexecutor = "cluster"\ncluster = "10.0.0.7"\n')
    with pytest.raises(ConfigurationError, match="such as tcp://"):
        load(file)
    file.write_text('[fusion]\nexecutor = "cluster"\ncluster = "tcp://10.0.0.7:8786"\n')
    assert load(file).fusion.cluster == "tcp://10.0.0.7:8786"
    assert {"executor", "cluster"}.isdisjoint(FusionSettings.model_fields)
