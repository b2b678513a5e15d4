"""Calibrations, frames, images and profiles that are damaged: a result that is right, or one clear line."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from hypothesis import given
from hypothesis import strategies as st
from made_frames import START, make_frame
from pydantic import ValidationError

from drivers import InitialisationError, RecordingError, sr4000_calibration
from drivers.backends import CAMERAS, STAGES, camera_class, make_camera, make_stage, stage_class
from drivers.calibration import Calibration, Corrections, CyclicTerm
from drivers.documents import parse_json, parse_toml, told
from drivers.lens_message import calibration_of
from drivers.messages import (
    FrameFields,
    calibration_message,
    decode_calibration,
    decode_image,
    frame_messages,
)
from drivers.settings import CameraSettings
from drivers.usb.profile import FOLDER, Profile
from solver import FusionError
from solver.geometry.lens import pixel_rays
from tests.hostile import PROFILE, VALUES, assert_one_clear_line, damaged, toml_document, torn

WHOLE = sr4000_calibration().model_copy(
    update={
        "width": 4,
        "height": 3,
        "corrections": Corrections(
            constant=0.01,
            cyclic=(CyclicTerm(amplitude=0.02, harmonic=4, phase=0.5),),
            per_pixel=((0.0, 0.1, 0.2, 0.3),) * 3,
        ),
    }
)
DOCUMENT = tomllib.loads(WHOLE.to_toml())
FRAME = make_frame(0, shape=(3, 4), burst=1, pose=2)
MESSAGES = {message.topic: message.payload for message in frame_messages(FRAME, WHOLE.mount)}
LENS = calibration_message(WHOLE, START).payload


def assert_usable(found: Calibration) -> None:
    """It can be written, read back, and every figure can be worked with."""
    assert Calibration.from_toml(found.to_toml()) == found
    K = found.intrinsics.matrix
    assert np.isfinite(K).all()
    assert min(K[0, 0], K[1, 1]) >= 1
    assert min(found.shape) >= 2
    assert max(found.shape) <= 65536
    if found.shape == (3, 4):
        corrected = found.correct(np.full((3, 4), 2.0, np.float32), 5.0)
        assert np.isfinite(corrected).all()
        try:
            assert np.isfinite(pixel_rays(found.shape, K, found.distortion or None)).all()
        except FusionError as error:  # a lens that folds
            assert_one_clear_line(error)


@PROFILE
@given(damaged(DOCUMENT).map(toml_document) | torn(WHOLE.to_toml().encode()) | st.binary(max_size=40))
def test_a_damaged_calibration_is_used_rightly_or_refused_in_a_line(content: bytes) -> None:
    try:
        found = Calibration.from_toml(content, "x.mcap: calibration.toml")
    except RecordingError as error:
        assert_one_clear_line(error, "x.mcap: calibration.toml: ")
    else:
        assert_usable(found)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("fx = 252.475", "fx = nan", "holds nan"),
        ("fx = 252.475", "fx = -252.475", "intrinsics.fx: Input should be greater than or equal to 1"),
        ("fx = 252.475", "fx = 0.0", "intrinsics.fx"),
        ("fx = 252.475", 'fx = "wide"', "intrinsics.fx: Input should be a valid number"),
        ("width = 4", "width = 1_000_000_000", "width: Input should be less than or equal to 65536"),
        ("width = 4", "width = 5", "per_pixel must have 3 rows of 5 values"),
        ("width = 4", "width = 1" + "0" * 5000, "not valid TOML"),
        ("width = 4", "width = 0x" + "f" * 9000, "more than 64 bits"),
        ("width = 4", "width = " + "[" * 3000 + "]" * 3000, "not valid TOML"),
        ("width = 4", "width = " + "[" * 100 + "]" * 100, "nested more than 32 deep"),
        (
            "distortion = [",
            "distortion = [ 0.1,",
            "distortion: Value error, 6 terms; expected",
        ),
    ],
)
def test_what_is_wrong_with_a_calibration_is_named(old: str, new: str, said: str) -> None:
    text = WHOLE.to_toml()
    assert old in text
    with pytest.raises(RecordingError, match=r"^calibration: ") as caught:
        Calibration.from_toml(text.replace(old, new))
    assert said in str(caught.value)
    assert_one_clear_line(caught.value)


def test_a_calibration_of_a_newer_version_is_read_and_what_is_passed_over_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = (
        WHOLE.to_toml()
        .replace("width = 4", 'width = 4\nseen_at = "20 °C"')
        .replace("fx =", "skew_of = 1\nfx =")
    )
    assert Calibration.from_toml(text, "new.mcap") == WHOLE
    (record,) = caplog.records
    assert record.getMessage() == (
        "new.mcap: passed over what this version does not know: intrinsics.skew_of, seen_at"
    )
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError, match="seen_at: Extra inputs are not permitted"):
        Calibration.load(path)


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(WHOLE.to_toml(), encoding="utf-8-sig")
    assert Calibration.load(path) == WHOLE
    path.write_bytes(b"\xff\xfew\0i\0")
    with pytest.raises(RecordingError, match=r"own\.toml: not a text file in UTF-8"):
        Calibration.load(path)


FIELDS = json.loads(MESSAGES["camera/frame"])


def _as_json(document: object) -> bytes:
    return json.dumps(document, default=str).encode()


@PROFILE
@given(damaged(FIELDS).map(_as_json) | torn(MESSAGES["camera/frame"]) | st.binary(max_size=40))
def test_damaged_fields_of_a_frame_are_used_rightly_or_refused(content: bytes) -> None:
    try:
        fields = FrameFields.model_validate_json(content)
    except ValidationError:
        return
    frame = fields.frame(FRAME.counts, FRAME.amplitude)
    for message in frame_messages(frame, WHOLE.mount):
        assert message.payload
    assert np.isfinite(frame.distance[frame.valid]).all()
    assert np.isfinite(frame.signal[frame.valid]).all()
    assert (frame.signal[frame.valid] >= 0).all()


@PROFILE
@given(
    st.builds(
        RawImage,
        width=st.sampled_from([0, 1, 3, 4, 10**9, 2**32 - 1]),
        height=st.sampled_from([0, 1, 3, 10**9, 2**32 - 1]),
        step=st.sampled_from([0, 1, 4, 8, 2**32 - 1]),
        encoding=st.sampled_from(["", "16UC1", "mono8", "rgb8", "32FC1", "x" * 30]),
        data=st.binary(max_size=40),
    ).map(RawImage.SerializeToString)
    | torn(MESSAGES["camera/distance"])
    | st.binary(max_size=40)
)
def test_a_damaged_image_is_read_whole_or_refused_in_a_line(payload: bytes) -> None:
    try:
        image = decode_image(payload)
    except RecordingError as error:
        assert_one_clear_line(error)
        return
    said = RawImage.FromString(payload)
    assert image.shape[:2] == (said.height, said.width)
    assert image.size > 0


NUMBERS = st.sampled_from([0.0, 1.0, -1.0, 250.0, float("nan"), float("inf"), 1e300, 5e-324]) | st.floats()


@PROFILE
@given(
    st.builds(
        CameraCalibration,
        width=st.sampled_from([0, 4, 10**9, 2**32 - 1]),
        height=st.sampled_from([0, 3, 10**9]),
        K=st.just([250.0, 0, 1.5, 0, 250.0, 1, 0, 0, 1]) | st.lists(NUMBERS, max_size=10),
        D=st.lists(NUMBERS, max_size=16),
        distortion_model=st.sampled_from(["", "plumb_bob", "rational_polynomial", "equidistant"]),
    ).map(CameraCalibration.SerializeToString)
    | torn(LENS)
    | st.binary(max_size=40)
)
def test_a_damaged_calibration_message_is_used_rightly_or_refused_in_a_line(payload: bytes) -> None:
    try:
        found = calibration_of(decode_calibration(payload), "x.mcap")
    except RecordingError as error:
        assert_one_clear_line(error)
    else:
        if found is not None:
            assert_usable(found)


SHIPPED = sorted(FOLDER.glob("*.toml"))[0].read_bytes()


@PROFILE
@given(damaged(tomllib.loads(SHIPPED.decode())).map(toml_document) | torn(SHIPPED))
def test_a_damaged_camera_profile_is_read_or_refused_in_a_line(content: bytes) -> None:
    path = Path(_folder) / "profile.toml"
    path.write_bytes(content)
    try:
        Profile.load(path)
    except InitialisationError as error:
        assert_one_clear_line(error, str(path))


@pytest.fixture(autouse=True, scope="module")
def _place(tmp_path_factory: pytest.TempPathFactory) -> None:
    global _folder
    _folder = str(tmp_path_factory.mktemp("documents"))


_folder = ""


@PROFILE
@given(damaged(CameraSettings().model_dump()))
def test_damaged_settings_are_within_bounds_or_refused(document: dict[str, object]) -> None:
    try:
        found = CameraSettings.model_validate(document)
    except ValidationError as error:
        assert_one_clear_line(ValueError(told(error)))
    else:
        assert 0 < found.integration_time <= 0.1
        assert 1.5 <= found.ambiguity_range <= 150
        assert found.frame_rate is None or 0 < found.frame_rate <= 1000


BACKENDS = [(make_camera, name, camera_class(name)) for name in sorted(CAMERAS)]
BACKENDS += [(make_stage, name, stage_class(name)) for name in sorted(STAGES)]  # type: ignore[list-item]


@PROFILE
@given(st.sampled_from(BACKENDS), st.data())
def test_damaged_options_of_a_backend_are_taken_or_refused_in_a_line(
    backend: Any, data: st.DataObject
) -> None:
    make, name, kind = backend
    key = data.draw(st.sampled_from([*kind.Options.model_fields, "x"]))
    try:
        make(name, {key: data.draw(VALUES)}, None)
    except InitialisationError as error:
        assert_one_clear_line(error, f"options of backend '{name}': ")


@pytest.mark.parametrize("parse", [parse_toml, parse_json])
def test_what_is_no_text_is_told(parse: object) -> None:
    with pytest.raises(ValueError, match=r"UTF-8 \(byte 0\)"):
        parse(b"\xff\xff")  # type: ignore[operator]
