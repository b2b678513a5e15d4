"""What a calibration message says of the lens, and what of it cannot be used."""

import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from made_frames import START

from drivers import RecordingError, sr4000_calibration
from drivers.calibration import Calibration
from drivers.lens_message import calibration_of
from drivers.messages import calibration_message

WHOLE = sr4000_calibration()
LENS = calibration_message(WHOLE, START).payload


def lens(**fields: object) -> Calibration | None:
    message = CameraCalibration.FromString(LENS)
    for name in fields:
        message.ClearField(name)  # type: ignore[arg-type]
    message.MergeFrom(CameraCalibration(**fields))  # type: ignore[arg-type]
    return calibration_of(message, "camera/calibration")


def test_a_calibration_message_comes_back() -> None:
    found = lens()
    assert found is not None
    assert (found.shape, found.intrinsics, found.distortion) == (
        WHOLE.shape,
        WHOLE.intrinsics,
        WHOLE.distortion,
    )


@pytest.mark.parametrize("model", ["kannala_brandt", "equidistant", "fisheye"])
@pytest.mark.parametrize("terms", [[0.1, -0.05, 0.02, -0.01], [0.0] * 4, []])
def test_a_lens_that_cannot_be_used_is_refused_by_name(model: str, terms: list[float]) -> None:
    """A fisheye's radius is f · θ even with all its terms zero."""
    with pytest.raises(RecordingError) as caught:
        lens(distortion_model=model, D=terms)
    assert str(caught.value) == (
        f"camera/calibration: the lens model '{model}' cannot be used here; known are plumb_bob, "
        "rational_polynomial: calibrate the camera with one of them and name the file in camera.calibration"
    )


@pytest.mark.parametrize("model", ["", "none", "plumb_bob", "rational_polynomial", "inverse_brown_conrady"])
def test_a_lens_without_distortion_is_a_pinhole_by_many_names(model: str) -> None:
    found = lens(distortion_model=model, D=[0.0] * 5)
    assert found is not None
    assert found.distortion == ()


@pytest.mark.parametrize(
    ("model", "given", "terms"),
    [
        ("plumb_bob", [0.1], (0.1, 0, 0, 0)),
        ("plumb_bob", [0.1, 0.2, 0, 0, 0.3, 0, 0, 0], (0.1, 0.2, 0, 0, 0.3)),
        ("rational_polynomial", [0.1] * 6, (*[0.1] * 6, 0, 0)),
        ("", [0.1, 0.2, 0.0, 0.0], (0.1, 0.2, 0, 0)),
    ],
)
def test_terms_that_lack_are_zero(model: str, given: list[float], terms: tuple[float, ...]) -> None:
    found = lens(distortion_model=model, D=given)
    assert found is not None
    assert found.distortion == terms


@pytest.mark.parametrize("K", [[0.0] * 9, []])
def test_a_matrix_of_zeros_says_not_calibrated(K: list[float]) -> None:
    assert lens(K=K) is None


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"K": [250.0] * 3}, "K has 3 values; expected 9"),
        ({"K": [250.0, 3, 2, 0, 250, 1, 0, 0, 1]}, "no skew"),
        ({"K": [-250.0, 0, 2, 0, 250, 1, 0, 0, 1]}, "fx: Input should be greater"),
        ({"K": [float("nan"), 0, 2, 0, 250, 1, 0, 0, 1]}, "fx"),
        ({"width": 0}, "width: Input should be greater than or equal to 2"),
        ({"D": [0.1] * 8, "distortion_model": "plumb_bob"}, "8 terms of distortion; expected at most 5"),
        ({"D": [0.1] * 15, "distortion_model": "rational_polynomial"}, "15 terms of distortion"),
    ],
)
def test_figures_that_are_none_are_named(fields: dict[str, object], said: str) -> None:
    with pytest.raises(RecordingError, match=r"^camera/calibration: ") as caught:
        lens(**fields)
    assert said in str(caught.value)
