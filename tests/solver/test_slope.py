"""The slope that the prior lets pass, and what it does to ramps."""

import cv2
import numpy as np
import pytest

from solver.geometry.positions import sample_positions
from solver.kernels.group import PAD
from solver.kernels.smoothing import gaussian
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.memory_gradient import minimise
from solver.optimisation.prior import Prior, level
from solver.optimisation.slope import agreed, apart, curvature_noise, slope
from solver.optimisation.term import start
from solver.options import Footprint


def padded(image: np.ndarray) -> np.ndarray:
    return np.pad(image.astype(np.float32), [(0, 0), (PAD, PAD), (PAD, PAD)])


def ramp(rows: int = 40, columns: int = 60) -> np.ndarray:
    i, j = np.mgrid[:rows, :columns]
    return np.stack([0.5 * i - 0.2 * j, 0.1 * i + 0.3 * j])


@pytest.mark.parametrize("reach", [2.0, 4.0, 5.0, 6.0, 8.0, 16.0])
def test_the_slope_of_a_ramp_is_its_rise_by_row_and_by_column(reach: float) -> None:
    found = slope(padded(ramp()), edge=100.0, reach=reach)[:, :, 12:-12, 12:-12]
    assert found == pytest.approx(
        np.broadcast_to([[[[0.5]], [[-0.2]]], [[[0.1]], [[0.3]]]], found.shape), abs=1e-3
    )


@pytest.mark.parametrize("reach", [3, 8, 11, 15, 29])
def test_a_gaussian_has_as_many_taps_as_the_loops_take(reach: int) -> None:
    """They take three at a time, and would read on beyond the last."""
    taps = gaussian(reach / 3.6, reach)
    assert taps.size > reach
    assert taps.size % 3 == 1
    assert 2 * taps.sum() - taps[0] == pytest.approx(1)


def test_a_ramp_costs_nothing_where_its_slope_is_known() -> None:
    x = padded(ramp())
    exact = np.zeros((2, 2, *x.shape[1:]), np.float32)
    exact[:, :, PAD:-PAD, PAD:-PAD] = np.array([[0.5, -0.2], [0.1, 0.3]])[..., None, None]
    one = np.ones_like(x[0])
    assert Prior().value(x, one) > 1000
    assert Prior().value(x, one, exact) == pytest.approx(0, abs=0.1)
    assert Prior().norms(x, exact).max() < 1e-4


def test_level_is_no_slope() -> None:
    x = padded(np.random.default_rng(1).normal(size=(2, 9, 11)))
    assert Prior().value(x, np.ones_like(x[0]), level(x)) == Prior().value(x, np.ones_like(x[0]))


def test_an_edge_has_no_say() -> None:
    step = np.zeros((1, 40, 60))
    step[:, :, 30:] = 50.0
    assert np.abs(slope(padded(step), edge=1.0)).max() < 0.01


@pytest.mark.slow
def test_the_gap_closes_with_a_slope_too() -> None:
    """Iteration and certificate agree on what the slope foretells: both bounds meet at the optimum."""
    rng = np.random.default_rng(5)
    shifts = np.array([[0, 0], [0.3, 0.45], [-0.4, 0.2], [0.15, -0.35]])
    positions = sample_positions((4, 6, 7), shifts=shifts)
    values = rng.normal(size=(2, 4, 6, 7)) + 3.0 * np.arange(7)
    term = AreaTerm(values, np.ones((4, 6, 7)), positions, 2, Footprint())
    state = start(np.zeros(term.shape))
    state.slope = np.zeros((2, 2, *state.x.shape[1:]))
    state.slope[:, :, PAD:-PAD, PAD:-PAD] = rng.normal(size=(2, 2, *term.shape[1:]))
    state.radius[...] = rng.uniform(0.5, 2.0, state.radius.shape)
    outcome = minimise(term, Prior(), state, tolerance=1e-13, limit=3000, rounding=1e-5)
    end = outcome.state
    _, bound = term.certify(end, Prior().duals(end.x, end.radius, end.slope, end.epsilon), Prior())
    assert outcome.objective * (1 - 1e-4) < bound <= outcome.objective * (1 + 1e-9)


def test_an_edge_differs_from_the_slope_that_was_found_before() -> None:
    """A ramp steeper than an edge may be has its say once it is known; what differs from it has none."""
    steep = padded(np.broadcast_to(3.0 * np.mgrid[:40, :60][1], (1, 40, 60)).copy())
    steep[:, :, PAD + 30 :] -= 5.0
    before = np.zeros((1, 2, *steep.shape[1:]), np.float32)
    before[:, 1] = 3.0
    inner = np.s_[0, 1, 12:-12, 12:-12]
    assert slope(steep, edge=0.3, reach=4.0, before=before)[inner] == pytest.approx(3.0, abs=0.02)
    assert np.ptp(slope(steep, edge=0.3, reach=4.0)[inner]) > 1


def test_the_slope_of_the_inverse_of_a_distance_is_that_of_a_plane() -> None:
    row = np.mgrid[:40, :60][0]
    distance = padded(1 / (0.5 - 0.01 * row)[None])
    measure = np.square(distance[0]) + np.float32(1e-6)
    found = measure * slope(distance, edge=1e3, reach=4.0, measure=measure)
    exact = 0.01 * distance[0] ** 2
    inner = np.s_[14:-14, 14:-14]
    np.testing.assert_allclose(found[0, 0][inner], exact[inner], rtol=0.06)
    plain = slope(distance, edge=1e3, reach=4.0)[0, 0]
    assert np.abs(plain - exact)[inner].max() > 2 * np.abs(found[0, 0] - exact)[inner].max()


def test_a_pixel_without_weight_has_no_say() -> None:
    x = padded(np.where(np.mgrid[:40, :60][1] < 30, 0.2, 0.5)[None] * np.mgrid[:40, :60][0])
    weight = np.zeros_like(x[0])
    weight[:, : PAD + 29] = 1
    found = slope(x, edge=1e3, reach=4.0, weight=weight)[0, 0, 12:-12, 12:40]
    assert found == pytest.approx(0.2, abs=1e-3)


def test_beside_a_fold_a_pixel_takes_the_slope_of_its_own_side() -> None:
    row = np.mgrid[:60, :40][0]
    x = padded(np.where(row < 30, 1.0, 1.0 + 0.5 * (row - 30))[None])
    measure = np.ones_like(x[0])
    about = slope(x, edge=1e3, reach=4.0)
    found, _ = agreed(x, about, 0.05, 4.0, measure, np.ones_like(measure), 1e-4)
    near = np.s_[0, 0, PAD + 24 : PAD + 29, 12:-12]
    assert about[near].max() > 0.15
    assert np.abs(found[near]).max() < 0.05
    beyond = np.s_[0, 0, PAD + 32 : PAD + 36, 12:-12]
    assert about[beyond].min() < 0.4
    assert np.abs(found[beyond] - 0.5).max() < 0.05
    assert not found[:, :, :PAD].any()
    assert not found[..., -PAD:].any()


def test_a_plane_of_inverse_distance_has_the_same_slope_in_every_window() -> None:
    distance = padded(1 / (0.5 - 0.005 * np.mgrid[:60, :40][0])[None])
    measure = np.square(distance[0]) + np.float32(1e-6)
    about = slope(distance, edge=1e3, reach=4.0, measure=measure)
    inner = np.s_[0, 0, 24:-24, 12:-12]
    found, _ = agreed(distance, about, 1e3, 5.0, measure, np.ones_like(measure), 0.0)
    np.testing.assert_allclose(found[inner], (measure * about)[inner], rtol=0.02)


def test_what_a_window_levels_is_put_back_unless_it_may_be_noise() -> None:
    """A wave of 14 reaches: its slope lacks a part in a window, and more in five of them."""
    column = np.mgrid[:60, :120][1]
    x = padded(np.sin(2 * np.pi * column / 56)[None])
    exact = 2 * np.pi / 56 * np.cos(2 * np.pi * (column + 0.5) / 56)[20:-20, 24:-24]
    one = np.ones_like(x[0])
    about = slope(x, edge=1e3, reach=4.0)

    def lacking(found: np.ndarray) -> float:
        part = found[0, 1, PAD:-PAD, PAD:-PAD][20:-20, 24:-24]
        return float(1 - (part * exact).sum() / (exact**2).sum())

    told, noisy = (agreed(x, about, 1e3, 4.0, one, one, level)[0] for level in (0.0, 100.0))
    assert lacking(about) > 0.08
    assert abs(lacking(told)) < 0.03
    assert lacking(noisy) > 1.5 * lacking(about)


def test_slopes_change_by_their_second_differences_and_not_at_all_on_a_plane() -> None:
    column = np.mgrid[:60, :80][1].astype(float)
    one, away = np.ones((64, 84), np.float32), apart(4.0)
    for x, change in ((0.3 * column, 0.0), (1e-4 * column**3, 6e-4 * away**2)):
        image = padded(x[None])
        about = slope(image, edge=1e3, reach=4.0)
        _, bent = agreed(image, about, 1e3, 4.0, one, one, 0.0)
        np.testing.assert_allclose(np.sqrt(bent[30:-30, 30:-30]), change, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("reach", [8.0, 12.0])
def test_the_noise_of_second_differences_is_that_of_white_noise(reach: float) -> None:
    """Of so much as a map lets pass: it is smooth over some pixels."""
    noise = cv2.GaussianBlur(np.random.default_rng(2).normal(size=(400, 400)), (0, 0), 1.5)[None]
    found = slope(padded(noise), edge=1e6, reach=reach)[0, :, PAD:-PAD, PAD:-PAD]
    away = apart(reach)
    near, far = slice(away, -away), 2 * away
    down = found[:, :-far, near] + found[:, far:, near] - 2 * found[:, near, near]
    right = found[:, near, :-far] + found[:, near, far:] - 2 * found[:, near, near]
    inner = np.s_[:, 24:-24, 24:-24]
    total = 2 * ((down[inner] ** 2).mean() + (right[inner] ** 2).mean())
    assert total == pytest.approx(curvature_noise(reach), rel=0.25)
