"""What is secret is shown nowhere: not in errors, in what is printed or recorded, in Zenoh's words."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers import sr3000_calibration
from service.capture.head import head_of
from service.config.file import load
from service.config.secrets import HIDDEN, is_secret, without_secrets
from service.errors import ConfigurationError, SessionError
from service.wire.session import open_session

SECRET = "hunter2-4711"


@pytest.mark.parametrize(
    "key", ["password", "passwd", "db_password", "API_KEY", "apikey", "token", "secret", "private_key", "key"]
)
def test_values_of_such_keys_are_hidden_wherever_they_stand(key: str) -> None:
    assert is_secret(key)
    told = {"sinks": {"x": {"options": {key: SECRET, "list": [{key: {"deep": SECRET}}], "rate": 3}}}}
    hidden = without_secrets(told)
    assert SECRET not in json.dumps(hidden)
    assert hidden["sinks"]["x"]["options"]["rate"] == 3


@pytest.mark.parametrize(
    "key", ["key_file", "token_path", "keyboard", "listen_private_key_file", "tolerance"]
)
def test_where_a_secret_lies_is_none(key: str) -> None:
    assert without_secrets({key: "/etc/x.pem"}) == {key: "/etc/x.pem"}


def test_a_password_in_an_address_is_hidden() -> None:
    assert without_secrets([f"https://me:{SECRET}@host/x"]) == [f"https://{HIDDEN}@host/x"]
    assert without_secrets("socket://host:4000") == "socket://host:4000"


def test_an_error_of_the_configuration_does_not_repeat_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(f'password = "{SECRET}"\n[camera]\ntimeout = {{ token = "{SECRET}" }}\n')
    monkeypatch.setenv("LIDARBOOST_SINKS__X__PASSWORD", SECRET)
    with pytest.raises(ConfigurationError) as caught:
        load(file)
    assert "password" in str(caught.value)
    assert SECRET not in str(caught.value)


def test_a_recording_bears_the_configuration_without_it(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(
        f'[zenoh]\nconfig = "/etc/zenoh.json5"\n'
        f'[sinks.x]\nkind = "m:C"\noptions = {{ password = "{SECRET}" }}\n'
        f'[camera.options]\nurl = "http://me:{SECRET}@camera"\n'
    )
    camera: Any = SimpleNamespace(source="device", model="SR3000", serial="7")
    told = repr(head_of(load(file), camera, sr3000_calibration()))
    assert SECRET not in told
    assert "/etc/zenoh.json5" in told
    assert HIDDEN in told


@pytest.mark.parametrize(
    "text",
    [
        f'{{ transport: {{ auth: {{ usrpwd: {{ user: "u", password: "{SECRET}" x }} }} }} }}',
        f'{{ transport: {{ auth: {{ usrpwd: "{SECRET}" }} }} }}',
        f'{{ listen: {{ endpoints: ["tls/127.0.0.1:1#listen_private_key_base64={SECRET}"] }} }}',
        f'{{ connect: {{ endpoints: ["x/y#password={SECRET}"] }} }}',
        '{ transport: { auth: { usrpwd: { user: "u", password: 47114711 } } } }',
    ],
)
def test_what_zenoh_says_of_its_file_does_not_quote_it(tmp_path: Path, text: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    with pytest.raises(SessionError) as caught, open_session((), (), file):
        pass
    assert SECRET not in str(caught.value)
    assert "4711" not in str(caught.value)
