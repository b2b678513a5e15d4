"""What others send and write, damaged or newer: read as far as it goes, or refused in one clear line."""

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import zenoh
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from hypothesis import example, given
from hypothesis import strategies as st
from test_remote_commands import run

from drivers import sr3000_calibration
from drivers.messages import calibration_message, image_message
from service.cli.status import _lines
from service.config.file import load
from service.config.sections import Configuration
from service.errors import ConfigurationError, RemoteError
from service.jobs.saving import as_json, describe, plain, summarize
from service.messages.decoding import Received, decode, read
from service.messages.report import BurstReport
from service.messages.status import Drops, LastError, Rates, Status, Totals
from service.sinks.recorder import RecorderState
from service.wire.client import Client
from service.wire.session import open_session
from tests.hostile import PROFILE, assert_one_clear_line, damaged, toml_document, torn

JSON = "application/json"
STATUS = json.loads(
    Status(
        timestamp=1_700_000_000_000_000_000,
        version="0.1.0",
        state="scanning",
        source="device",
        model="SR3000",
        serial="7",
        uptime=12.5,
        totals=Totals(frames=4, bursts=3, fused=2),
        rates=Rates(frames=1.5, fused=0.1),
        drops=Drops(camera=1),
        backlog=1,
        latency=0.5,
        recorder=RecorderState(recording=True, file="a.mcap", size=7, messages=3, free=1000),
        error=LastError(what="none yet", timestamp=7),
    ).model_dump_json()
)
CLOUD = PointCloud(
    point_stride=12,
    fields=[
        PackedElementField(name=name, offset=4 * place, type=PackedElementField.FLOAT32)
        for place, name in enumerate("xyz")
    ],
    data=np.arange(6, dtype="<f4").tobytes(),
)
DEPTH = image_message("fused/depth", np.ones((3, 4), np.float32), "32FC1", timestamp=5).payload
LENS = calibration_message(sr3000_calibration(), 5).payload
LOG = Log(message="ä", level=Log.ERROR).SerializeToString()


def dumped(document: object) -> bytes:
    return json.dumps(document).encode()


SCHEMAS = [
    "RawImage",
    "PointCloud",
    "CameraCalibration",
    "Log",
    "FrameTransform",
    "Nothing",
    "os",
    "",
    "a.b",
    "\0",
]
ENCODINGS = st.sampled_from(
    [JSON, "", "zenoh/bytes", *(f"application/protobuf;foxglove.{s}" for s in SCHEMAS)]
)
PAYLOADS = st.one_of(
    damaged(STATUS).map(dumped),
    *(torn(content) for content in (dumped(STATUS), DEPTH, LENS, LOG, CLOUD.SerializeToString())),
    st.binary(max_size=30),
    st.sampled_from(
        [b"[1]", b"null", b"NaN", b'{"timestamp": "now"}', b"[" * 100_000, b"{" + b'"a":' * 50 + b"1"]
    ),
)


def assert_shown(received: Received) -> None:
    """Everything that the command line does with it goes well."""
    assert summarize(received)
    assert describe(received)
    json.loads(as_json(received))
    plain(received)
    assert received.timestamp is None or 0 <= received.timestamp < 2**63


@PROFILE
@given(ENCODINGS, PAYLOADS)
def test_a_damaged_message_is_shown_or_refused_in_a_line(encoding: str, payload: bytes) -> None:
    try:
        received = decode("some/topic", encoding, payload)
    except RemoteError as error:
        assert_one_clear_line(error, "some/topic: cannot read")
    else:
        assert_shown(received)


@PROFILE
@given(
    st.lists(
        st.builds(
            PackedElementField,
            name=st.sampled_from(["x", "y", "", "ä"]),
            offset=st.sampled_from([0, 4, 8, 2**32 - 1]),
            type=st.integers(0, 9),
        ),
        max_size=4,
    ),
    st.sampled_from([0, 1, 12, 16, 2**32 - 1]),
)
def test_damaged_points_are_shown_or_refused_in_a_line(fields: list[Any], stride: int) -> None:
    cloud = PointCloud(fields=fields, point_stride=stride, data=CLOUD.data)
    encoding = "application/protobuf;foxglove.PointCloud"
    try:
        received = decode("fused/points", encoding, cloud.SerializeToString())
    except RemoteError as error:
        assert_one_clear_line(error)
    else:
        assert_shown(received)
        assert received.value.nbytes == len(CLOUD.data)


def test_points_with_fields_of_other_types_are_read_as_such() -> None:
    layout = np.dtype([("x", "<f8"), ("ring", "u1")])
    points = np.array([(1.5, 7), (2.5, 9)], layout)
    cloud = PointCloud(
        point_stride=9,
        fields=[
            PackedElementField(name="x", offset=0, type=PackedElementField.FLOAT64),
            PackedElementField(name="ring", offset=8, type=PackedElementField.UINT8),
        ],
        data=points.tobytes(),
    )
    found = decode(
        "fused/points", "application/protobuf;foxglove.PointCloud", cloud.SerializeToString()
    ).value
    np.testing.assert_array_equal(found, points)


@PROFILE
@given(damaged(STATUS).map(dumped) | torn(dumped(STATUS)))
def test_a_damaged_status_is_shown_or_refused_in_a_line(payload: bytes) -> None:
    try:
        shown = dict(_lines(read(Status, decode("status", JSON, payload))))
    except RemoteError as error:
        assert_one_clear_line(error, "status: ")
    else:
        assert shown.keys() >= {"state", "frames", "maps"}


def test_what_a_newer_service_adds_is_passed_over_and_what_an_older_one_lacks_has_a_default() -> None:
    newer = STATUS | {"temperature": 41.5, "state": "paused", "source": "bridge"}
    newer["drops"] = STATUS["drops"] | {"events": 3}
    newer["recorder"] = STATUS["recorder"] | {"codec": "zstd"}
    found = read(Status, Received("status", newer, None))
    assert (found.state, found.source, found.drops.camera) == ("paused", "bridge", 1)
    assert found.recorder is not None
    assert found.recorder.file == "a.mcap"
    older = read(Status, Received("status", {"state": "idle"}, None))
    assert (older.state, older.totals.frames, older.recorder) == ("idle", 0, None)
    with pytest.raises(RemoteError, match=r"uptime: Input should be a valid number.*install the same"):
        read(Status, Received("status", STATUS | {"uptime": "long"}, None))


@pytest.mark.parametrize("model", [Status, BurstReport, RecorderState])
def test_published_schemas_allow_for_more_fields(model: type) -> None:
    said = json.dumps(model.model_json_schema(mode="serialization"))  # type: ignore[attr-defined]
    assert '"additionalProperties": false' not in said


@contextmanager
def serving(endpoint: str, values: dict[str, tuple[str, bytes]]) -> Iterator[None]:
    """A service of another version: it answers with these bytes (encoding, payload) by topic."""
    with open_session([endpoint]) as session:
        asked = [
            session.declare_queryable(
                f"lidarboost/rig/{topic}",
                lambda query, encoding=encoding, payload=payload: query.reply(
                    query.key_expr, payload, encoding=zenoh.Encoding(encoding)
                ),
            )
            for topic, (encoding, payload) in values.items()
        ]
        yield
        for queryable in asked:
            queryable.undeclare()  # type: ignore[no-untyped-call]


def test_the_status_of_a_newer_service_is_shown(endpoint: str) -> None:
    newer = STATUS | {"temperature": 41.5, "drops": {}, "recorder": None}
    with serving(endpoint, {"status": (JSON, dumped(newer))}):
        code, out, err = run("status", "--endpoint", endpoint)
        assert (code, err) == (0, "")
        assert "lidarboost 0.1.0, up 12 s" in out
        assert json.loads(run("status", "--json", "--endpoint", endpoint)[1]) == newer
        assert json.loads(run("get", "status", "--endpoint", endpoint)[1]) == newer


def test_a_status_that_is_none_is_one_line(endpoint: str) -> None:
    with serving(endpoint, {"status": (JSON, dumped(STATUS | {"totals": 3}))}):
        code, out, err = run("status", "--endpoint", endpoint)
    assert (code, out) == (1, "")
    assert err.startswith("error: status: what came is not what this version reads (totals: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"K": [0.0] * 9}, None),
        ({"distortion_model": "kannala_brandt"}, "the lens model 'kannala_brandt' cannot be used here"),
        ({"K": [200.0] * 4}, "K has 4 values; expected 9"),
    ],
)
def test_an_image_comes_with_a_lens_that_can_be_used_or_with_none(
    endpoint: str, fields: dict[str, Any], said: str | None
) -> None:
    lens = CameraCalibration.FromString(LENS)
    for name in fields:
        lens.ClearField(name)  # type: ignore[arg-type]
    lens.MergeFrom(CameraCalibration(**fields))
    values = {
        "fused/depth": ("application/protobuf;foxglove.RawImage", DEPTH),
        "fused/calibration": ("application/protobuf;foxglove.CameraCalibration", lens.SerializeToString()),
    }
    with serving(endpoint, values), Client(endpoint) as client:
        if said is None:
            image = client.latest("fused/depth")
            assert image.value.shape == (3, 4)
            assert image.intrinsics is None
        else:
            with pytest.raises(RemoteError, match=said):
                client.latest("fused/depth")


CONFIGURATION = tomllib.loads(
    tomli_w.dumps(
        Configuration(
            camera={"options": {"scene": "objects", "seed": 3}, "settings": {"integration_time": 0.01}},
            zenoh={"config": "a.json5"},
        ).model_dump(mode="json", exclude_none=True)
    )
)


@pytest.fixture(autouse=True, scope="module")
def _surroundings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    kept = {name: os.environ.pop(name) for name in list(os.environ) if name.startswith("LIDARBOOST_")}
    _written.append(tmp_path_factory.mktemp("configuration") / "rig.toml")
    yield
    os.environ.update(kept)


_written: list[Path] = []


@PROFILE
@given(
    damaged(CONFIGURATION).map(toml_document) | torn(toml_document(CONFIGURATION)) | st.binary(max_size=30)
)
def test_a_damaged_configuration_is_taken_whole_or_refused_in_a_line(content: bytes) -> None:
    _written[0].write_bytes(content)
    try:
        found = load(_written[0])
    except ConfigurationError as error:
        assert_one_clear_line(error)
    else:
        again = tomli_w.dumps(found.model_dump(mode="json", exclude_none=True))
        assert Configuration.model_validate(tomllib.loads(again)) == found


VARIABLES = ["FUSION__FRAMES", "FUSION", "CAMERA__OPTIONS", "ZENOH__PREFIX", "CAMERA__RECORDING", "X__Y"]


def tables(depth: int) -> str:
    return '{"a": ' * depth + "1" + "}" * depth


@PROFILE
@example("CAMERA__OPTIONS", tables(60))
@example("CAMERA__OPTIONS", tables(900))
@example("CAMERA__OPTIONS", tables(15_000))
@given(
    st.sampled_from(VARIABLES),
    st.sampled_from([tables(1), "{" * 5000, "[" * 60 + "]" * 60, "1" * 5000, "1e999", "nan"])
    | st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9),
)
def test_a_damaged_environment_is_taken_or_refused_in_a_line(name: str, value: str) -> None:
    os.environ[f"LIDARBOOST_{name}"] = value
    try:
        found = load()
    except ConfigurationError as error:
        assert_one_clear_line(error)
    else:
        assert tomli_w.dumps(found.model_dump(mode="json", exclude_none=True))
    finally:
        del os.environ[f"LIDARBOOST_{name}"]
