"""What a command says of what it does not understand, and of what is out of bounds."""

import json

import pytest


@pytest.mark.parametrize(
    ("payload", "code", "said"),
    [
        ("", "INVALID_ARGUMENT", "not JSON"),
        ("[" * 100_000, "INVALID_ARGUMENT", "not JSON"),
        ('{"action": "set", "integration_time": NaN}', "INVALID_ARGUMENT", "not JSON"),
        ("[]", "INVALID_ARGUMENT", 'expected {"action": …} with one of get, set; got []'),
        ('{"action": "wipe"}', "INVALID_ARGUMENT", "one of get, set; got 'wipe'"),
        ('{"action": {"a": 1}}', "INVALID_ARGUMENT", "one of get, set"),
        ('{"action": "get", "all": 1}', "INVALID_ARGUMENT", "unknown field 'all' (known: none)"),
        (
            '{"action": "set", "colour": 1}',
            "INVALID_ARGUMENT",
            "unknown field 'colour' (known: integration_time",
        ),
        ('{"action": "set", "integration_time": "1"}', "INVALID_ARGUMENT", "integration_time = '1'"),
        ('{"action": "set", "integration_time": 9}', "OUT_OF_RANGE", "less than or equal to 0.1"),
        ('{"action": "set", "integration_time": 1e999}', "OUT_OF_RANGE", "integration_time"),
        ('{"action": "set", "frame_rate": -1}', "OUT_OF_RANGE", "frame_rate = -1"),
        ('{"action": "set", "frame_rate": 1e-300}', "OUT_OF_RANGE", "greater than or equal to 0.001"),
        (
            '{"action": "set", "integration_time": 1e-300}',
            "OUT_OF_RANGE",
            "greater than or equal to 0.000001",
        ),
        ('{"action": "set", "frame_rate": "1"}', "INVALID_ARGUMENT", "frame_rate = '1'"),
    ],
)
def test_what_is_not_understood_is_refused_with_what_is_allowed(payload: str, code: str, said: str) -> None:
    from service.daemon.commands import commands
    from service.errors import CommandError

    with pytest.raises(CommandError) as caught:
        commands()["cmd/settings"].read(payload.encode())
    assert caught.value.code == code
    assert said in str(caught.value)
    assert len(str(caught.value)) < 1000
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "payload", "code", "said"),
    [
        (
            "cmd/fusion",
            {"action": "set", "regularization": -1},
            "OUT_OF_RANGE",
            "cmd/fusion set: regularization = -1: Input should be greater than 0 (λ",
        ),
        (
            "cmd/record",
            {"action": "fetch"},
            "INVALID_ARGUMENT",
            "cmd/record fetch: 'file' is missing (In the recording folder.)",
        ),
        (
            "cmd/replay",
            {"action": "seek"},
            "INVALID_ARGUMENT",
            "cmd/replay seek: expected one of seconds, burst and frame",
        ),
    ],
)
def test_a_refusal_names_the_field_and_what_is_expected(
    name: str, payload: dict[str, object], code: str, said: str
) -> None:
    from service.daemon.commands import commands
    from service.errors import CommandError

    with pytest.raises(CommandError) as caught:
        commands()[name].read(json.dumps(payload).encode())
    assert caught.value.code == code
    assert str(caught.value).startswith(said)
    assert "'auto'" not in str(caught.value).split("(")[0]
