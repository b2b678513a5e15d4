"""Distance to depth, points, normals, and the fused camera."""

import cv2
import numpy as np
import pytest

from solver.errors import FusionInputError
from solver.geometry.points import (
    depth_from_distance,
    distance_from_depth,
    fused_intrinsics,
    normals_from_points,
    points_from_distance,
    rotations_to_shifts,
    shifts_to_rotations,
)

K = np.array([[60.0, 0, 30.0], [0, 61.0, 20.0], [0, 0, 1]])
LENS = [-0.2, 0.05, 0.001, -0.001, 0.0]


@pytest.mark.parametrize("lens", [None, LENS])
def test_points_project_back_to_their_pixels_at_their_distance(lens):
    distance = np.random.default_rng(0).uniform(1, 3, (40, 60)).astype(np.float32)
    points = points_from_distance(distance, K, lens)
    assert np.allclose(np.linalg.norm(points, axis=2), distance, rtol=1e-6)
    image, _ = cv2.projectPoints(
        points.reshape(-1, 1, 3).astype(float), np.zeros(3), np.zeros(3), K, np.array(lens or [0.0] * 4)
    )
    rows, columns = np.indices((40, 60))
    assert np.abs(image.reshape(40, 60, 2) - np.stack([columns, rows], axis=-1)).max() < 1e-4
    assert np.allclose(depth_from_distance(distance, K, lens), points[..., 2])


def test_depth_and_distance_are_inverses_and_keep_unknown_pixels():
    depth = np.full((2, 40, 60), 2.0, np.float32)
    depth[1, 3, 4] = np.nan
    back = depth_from_distance(distance_from_depth(depth, K, LENS), K, LENS)
    assert np.allclose(back, depth, equal_nan=True)


def test_normals_of_a_plane_face_the_camera_and_do_not_bend_at_a_step():
    depth = np.where(np.arange(60) < 30, 2.0, 3.0) * np.ones((40, 1))
    normals = normals_from_points(points_from_distance(distance_from_depth(depth, K), K))
    assert np.allclose(normals, [0, 0, -1], atol=1e-4)


def test_a_normal_beside_unknown_pixels_is_unknown_only_when_isolated():
    points = np.dstack([*np.meshgrid(np.arange(5.0), np.arange(5.0)), np.full((5, 5), 4.0)])
    points[1, 2] = points[3, 2] = points[2, 1] = points[2, 3] = np.nan
    normals = normals_from_points(points)
    assert np.isnan(normals[2, 2]).all()
    assert np.allclose(normals[0, 0], [0, 0, -1])


def test_fused_intrinsics_keep_the_rays_of_the_image_corners():
    fused = fused_intrinsics(K, 4)
    assert fused[0, 0] == 240
    # The outer corner of the first pixel is at −½ at both resolutions, and is the same ray.
    assert (-0.5 - fused[0, 2]) / fused[0, 0] == pytest.approx((-0.5 - K[0, 2]) / K[0, 0])
    assert np.array_equal(fused_intrinsics(K, 1), K)
    with pytest.raises(FusionInputError, match="positive integer"):
        fused_intrinsics(K, 0)


@pytest.mark.parametrize("lens", [None, LENS])
def test_shifts_and_rotations_are_inverses_at_the_image_centre(lens):
    shifts = np.array([[0.0, 0], [3.2, -5.1], [-8, 4]])
    turns = shifts_to_rotations(shifts, (40, 60), K, lens)
    assert np.allclose(rotations_to_shifts(turns, (40, 60), K, lens), shifts, atol=1e-9)
    assert turns[1, 0] < 0  # looking down is a negative turn about x
    assert turns[1, 1] < 0  # looking left is a negative turn about y


def test_bad_shapes_are_refused():
    with pytest.raises(FusionInputError):
        rotations_to_shifts(np.zeros(3), (4, 4), K)
    with pytest.raises(FusionInputError):
        shifts_to_rotations(np.zeros((1, 3)), (4, 4), K)
    with pytest.raises(FusionInputError):
        normals_from_points(np.zeros((4, 4)))
    with pytest.raises(FusionInputError):
        depth_from_distance(np.zeros(4), K)
