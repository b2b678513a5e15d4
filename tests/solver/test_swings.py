"""Swings fill an area, edges lie apart."""

import numpy as np
import pytest

from solver.optimisation.swings import find_swings


def norms(rows: int = 80, columns: int = 90) -> np.ndarray:
    return np.zeros((rows + 4, columns + 4), np.float32)


def test_a_scene_has_none() -> None:
    scene = norms()
    scene[2:-2:8, :] = 100
    scene[:, 2:-2:8] = 100
    assert find_swings(scene, 1.0) is None


def test_swings_are_found_where_they_are() -> None:
    map = norms()
    map[2:-2, 42:-2] = 100
    found = find_swings(map, 1.0)
    assert found is not None
    assert found.shape == map.shape
    assert found.dtype == np.float32
    assert found[40, 60:-2] == pytest.approx(1.0)
    assert found[40, :30] == pytest.approx(0.0)


@pytest.mark.parametrize("shape", [(1, 40), (5, 3), (1, 1)])
def test_an_image_may_be_smaller_than_what_is_looked_at(shape: tuple[int, int]) -> None:
    found = find_swings(norms(*shape) + 100, 1.0)
    assert found is not None
    assert found[2:-2, 2:-2] == pytest.approx(1.0)
