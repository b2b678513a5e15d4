"""Where pixels look: signs, rotations, lenses."""

import cv2
import numpy as np
import pytest

from solver.errors import FusionInputError
from solver.geometry.lens import pixel_rays
from solver.geometry.positions import rotation_matrix, rotation_vector, sample_positions

K = np.array([[200.0, 0, 87.0], [0, 201.0, 71.5], [0, 0, 1]])
LENSES = [
    None,
    [-0.3, 0.12, 0.001, -0.002],
    [-0.3, 0.12, 0.001, -0.002, -0.02],
    [-0.3, 0.12, 0.001, -0.002, -0.02, 0.01, 0.02, 0.01],
    [-0.3, 0.12, 0.001, -0.002, -0.02, 0.01, 0.02, 0.01, 0.001, 0.002, 0.001, 0.001, 0.03, -0.02],
]


def test_a_positive_shift_looks_down_and_right():
    positions = sample_positions((2, 5, 7), shifts=[[0, 0], [1.25, -0.5]])
    assert positions.dtype == np.float32
    assert positions[0, 3, 4] == pytest.approx((3, 4))
    assert positions[1, 3, 4] == pytest.approx((4.25, 3.5))


def test_a_turn_to_the_right_looks_right_and_a_turn_up_looks_up():
    right, up = [0, 0.01, 0], [0.01, 0, 0]  # about y (down) and x (right)
    positions = sample_positions((2, 144, 176), rotations=[right, up], intrinsics=K)
    middle = positions[:, 72, 87]
    assert middle[0] == pytest.approx((72, 87 + 2.0), abs=0.01)
    assert middle[1] == pytest.approx((72 - 2.01, 87), abs=0.01)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{len(lens or [])} coefficients")
def test_positions_agree_with_opencv(lens):
    turn = np.array([0.02, -0.05, 0.1])
    positions = sample_positions((1, 144, 176), rotations=turn[None], intrinsics=K, distortion=lens)
    rows, columns = np.indices((144, 176), dtype=float)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    coefficients = np.zeros(4) if lens is None else np.array(lens)
    undistorted = cv2.undistortPoints(pixels, K, coefficients, None, None, None, (3, 200, 1e-14))
    rays = np.concatenate([undistorted, np.ones((len(pixels), 1, 1))], axis=-1)
    expected, _ = cv2.projectPoints(rays, turn, np.zeros(3), K, coefficients)
    assert np.abs(expected.reshape(144, 176, 2)[..., ::-1] - positions[0]).max() < 2e-5


def test_no_turn_is_the_identity_through_any_lens():
    positions = sample_positions((1, 40, 50), rotations=np.zeros((1, 3)), intrinsics=K, distortion=LENSES[-1])
    assert np.abs(positions[0] - np.moveaxis(np.indices((40, 50)), 0, -1)).max() < 1e-5


def test_a_ray_turned_behind_the_camera_has_no_position():
    positions = sample_positions((1, 10, 10), rotations=[[0, 2.5, 0]], intrinsics=K)
    assert np.isnan(positions).all()


def test_rotation_vectors_and_matrices_are_inverses():
    turns = np.random.default_rng(1).uniform(-1.5, 1.5, (50, 3))
    matrices = rotation_matrix(turns)
    assert np.allclose(matrices @ matrices.transpose(0, 2, 1), np.eye(3))
    assert np.allclose(rotation_vector(matrices), turns)
    assert np.allclose(rotation_vector(np.eye(3)), 0)
    assert np.allclose(matrices[0], cv2.Rodrigues(turns[0])[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "either"),
        ({"shifts": np.zeros((2, 2)), "rotations": np.zeros((2, 3))}, "not both"),
        ({"shifts": np.zeros((3, 2))}, r"expected \(2, 2\)"),
        ({"shifts": [[0, 0], [np.nan, 0]]}, r"frames \[1\]"),
        ({"rotations": np.zeros((2, 3))}, "intrinsics"),
        ({"rotations": np.zeros((2, 3)), "intrinsics": np.zeros((3, 3))}, "focal"),
        ({"rotations": np.zeros((2, 3)), "intrinsics": np.eye(2)}, "shape"),
        ({"rotations": np.zeros((2, 3)), "intrinsics": K, "distortion": [1, 2, 3]}, "distortion"),
    ],
)
def test_bad_input_is_named(arguments, words):
    with pytest.raises(FusionInputError, match=words):
        sample_positions((2, 4, 4), **arguments)


def test_a_lens_that_folds_inside_the_image_is_refused():
    with pytest.raises(FusionInputError, match="inverted"):
        pixel_rays((144, 176), K, [-3.0, 0, 0, 0])
