"""Rotations, against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers.rotations import quaternion, rotation_matrix, rotation_vector


@pytest.mark.parametrize("largest", [1e-9, 1e-4, 0.1, 3.1])
def test_they_are_those_of_scipy(largest: float) -> None:
    vectors = np.random.default_rng(1).normal(size=(200, 3))
    vectors *= largest / np.linalg.norm(vectors, axis=1).max()
    known = Rotation.from_rotvec(vectors)
    matrices = rotation_matrix(vectors)
    np.testing.assert_allclose(matrices, known.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(quaternion(matrices), known.as_quat(canonical=True), atol=1e-15)
    np.testing.assert_allclose(rotation_vector(matrices), vectors, rtol=1e-12, atol=1e-15 * max(1, largest))


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, -0.8)])
def test_half_a_turn_has_an_axis_too(axis: tuple[float, ...]) -> None:
    matrix = rotation_matrix(np.pi * np.array(axis))
    assert np.linalg.norm(rotation_vector(matrix)) == pytest.approx(np.pi)
    np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=1e-14)


def test_no_turn_is_none() -> None:
    assert not rotation_vector(np.eye(3)).any()
    np.testing.assert_array_equal(rotation_matrix(np.zeros(3)), np.eye(3))
    np.testing.assert_array_equal(quaternion(np.eye(3)), (0, 0, 0, 1))
