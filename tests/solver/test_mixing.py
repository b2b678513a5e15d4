"""Cells that two surfaces share go to the one that has more of the cell, not to the brighter one."""

from typing import Any

import numpy as np
import pytest

from solver.kernels.mixing import settle

RANGE, STEP, SLOPE = 7.5, 0.4, 0.01
LAW = 0.02, 0.15, 10.0, 0.01, 0.001


def phasors(distance: Any, light: Any) -> Any:
    return light * np.exp(2j * np.pi * np.asarray(distance) / RANGE)


def settled(z: Any, cut: float = 0.0) -> Any:
    distance = ((np.angle(z) * RANGE / (2 * np.pi) - cut) % RANGE + cut).astype(np.float32)
    out = np.empty_like(distance)
    settle(0, 1, distance, np.abs(z).astype(np.float32), RANGE, cut, 0.03, 0.15, LAW, out)
    return out, distance


def edge(near: float, far: float, share: float, first: float = 2.0) -> Any:
    """A column of cells, the middle one by `share` of the far surface; lights of the near and the far one."""
    z = np.array([phasors(first, near)] * 3 + [0] + [phasors(first + STEP, far)] * 3)
    z[3] = (1 - share) * z[0] + share * z[-1]
    return z


@pytest.mark.parametrize("lights", [(1.0, 1.0), (1.0, 0.3), (0.3, 1.0), (1.0, 0.05)])
@pytest.mark.parametrize("share", [0.2, 0.8])
@pytest.mark.parametrize("across", [False, True])
def test_mixed_cells_go_to_the_larger_part(lights: tuple[float, float], share: float, across: bool) -> None:
    z = np.repeat(edge(*lights, share)[:, None], 6, axis=1)
    found, _ = settled(z.T if across else z)
    found = found.T if across else found
    assert found[3] == pytest.approx(2.0 + STEP * (share > 0.5), abs=1e-4)
    assert found[[0, 1, 2]] == pytest.approx(2.0, abs=1e-4)


def test_a_cell_of_halves_stays_between() -> None:
    found, _ = settled(np.repeat(edge(1.0, 1.0, 0.5)[:, None], 6, axis=1))
    assert found[3] == pytest.approx(2.0 + STEP / 2, abs=1e-3)


def test_light_tells_where_phase_cannot() -> None:
    """A fiftieth of the light hardly turns the mixture."""
    z = np.repeat(edge(1.0, 0.02, 0.85)[:, None], 6, axis=1)
    z[3] = np.abs(z[3]) * z[0] / np.abs(z[0])
    found, before = settled(z)
    assert before[3] == pytest.approx(2.0, abs=1e-4)
    assert found[3] == pytest.approx(2.0 + STEP, abs=1e-4)


def test_across_the_end_of_the_range() -> None:
    found, _ = settled(np.repeat(edge(1.0, 1.0, 0.8, first=7.3)[:, None], 6, axis=1), cut=0.1)
    assert found[3] == pytest.approx((7.3 + STEP) % RANGE, abs=1e-3)


def test_slopes_things_of_one_cell_and_the_unknown_stay() -> None:
    slope = np.repeat((2.0 + 0.05 * np.arange(9))[:, None], 9, axis=1)
    bar = np.full((9, 9), 2.5)
    bar[:, 4] = 2.0
    for distance in (slope, bar):
        found, before = settled(phasors(distance, 1.0))
        assert np.array_equal(found, before)
    z = np.repeat(edge(1.0, 1.0, 0.8)[:, None], 6, axis=1)
    distance = (np.angle(z) * RANGE / (2 * np.pi)).astype(np.float32)
    distance[5:] = np.nan
    out = np.empty_like(distance)
    settle(0, 1, distance, np.abs(z).astype(np.float32), RANGE, 0.0, 0.03, 0.15, LAW, out)
    assert np.array_equal(out, distance, equal_nan=True)


def test_a_diagonal_line_of_dark_cells_stays() -> None:
    z = np.repeat(phasors(2.0 + 0.002 * np.arange(9), 1.0)[:, None], 9, axis=1)
    z[range(9), range(9)] = phasors(2.5, 0.5)
    found, before = settled(z)
    np.testing.assert_array_equal(found, before)
