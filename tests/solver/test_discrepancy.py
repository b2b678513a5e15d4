"""How far map and samples are apart, and what a prior makes of it."""

import numpy as np
import pytest

from solver.geometry.positions import sample_positions
from solver.kernels import agreement
from solver.kernels.group import PAD
from solver.optimisation.discrepancy import discrepancy, eased, hidden
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.information import doubt
from solver.options import Footprint

FRAMES, ROWS, COLUMNS = 12, 40, 44
NOISE = 0.01  # of each component, light being 1


def apart(factor, relief=0.0, period=8.0, footprint=None, seed=0, noise=1.0):
    """The discrepancy of a level map of samples of waves so many radian high and pixels long."""
    rng = np.random.default_rng(seed)
    shifts = rng.uniform(-1, 1, (FRAMES, 2))
    shape = (FRAMES, ROWS, COLUMNS)
    positions = sample_positions(shape, shifts=shifts)
    phase = relief * np.sin(2 * np.pi * positions[..., 0] / period)
    values = np.stack([np.cos(phase), np.sin(phase)]) + NOISE * rng.normal(size=(2, *shape))
    term = AreaTerm(
        values.astype(np.float32), np.ones(shape, np.float32), positions, factor, footprint or Footprint()
    )
    z = np.zeros((2, *(n + 2 * PAD for n in term.shape[1:])), np.float32)
    z[0, PAD:-PAD, PAD:-PAD] = 1
    pull, weight = np.zeros_like(z), np.float32(1 / NOISE**2)
    term.pull(z, weight, pull)
    return discrepancy(z, pull, term, weight, noise)[6:-6, 6:-6]


@pytest.mark.parametrize("factor", [1, 2, 3, 4, 8])
def test_noise_alone_is_as_much_at_every_upsampling(factor):
    # The larger of two means over a window, one of them of a gradient that is averaged first.
    assert np.mean([apart(factor, seed=seed) for seed in range(8)]) == pytest.approx(1.9, abs=0.2)


@pytest.mark.parametrize("footprint", [Footprint(side=0.5), Footprint(blur=0.3)])
def test_noise_alone_is_as_much_whatever_a_pixel_sees(footprint):
    told = [apart(4, footprint=footprint, seed=seed) for seed in range(8)]
    assert np.mean(told) == pytest.approx(1.9, abs=0.2)


def test_where_there_is_more_noise_less_is_fitted_to_it():
    assert (apart(4, noise=8.0) < 0.8 * apart(4)).all()


def test_what_reaches_over_some_pixels_is_told_though_it_is_below_the_noise():
    told = apart(4, relief=0.5 * NOISE)
    assert np.quantile(told, 0.05) > np.quantile(apart(4), 0.95)


def test_waves_of_two_and_a_half_pixels_are_told_too():
    told = apart(4, relief=2 * NOISE, period=2.5)
    assert np.quantile(told, 0.05) > np.quantile(apart(4), 0.95)


def test_a_prior_gives_way_where_the_samples_bear_more_and_comes_back_where_they_do_not():
    ease = np.full((3, 4), 2, np.float32)
    np.testing.assert_allclose(eased(ease, ease), 4)
    np.testing.assert_allclose(eased(ease, ease / 8), 1)
    np.testing.assert_allclose(eased(ease, ease * 100), 20)


def test_what_is_hidden_is_sure_well_beyond_agreement():
    assert (hidden(np.array([0.3, 1.0], np.float32)) == 0).all()
    assert 0 < hidden(np.array([1.3], np.float32))[0] < 1
    assert (hidden(np.array([2.0, 9.0], np.float32)) == 1).all()


def test_slopes_are_brought_nearer_to_others_by_their_share():
    rng = np.random.default_rng(4)
    near, out = (rng.normal(size=(2, 11, 12)).astype(np.float32) for _ in range(2))
    measure = rng.uniform(1, 2, (11, 12)).astype(np.float32)
    share = rng.uniform(size=(7, 8)).astype(np.float32)
    inner = np.s_[:, 2:-2, 2:-2]
    wanted = out[inner] + share * (near[inner] * measure[inner[1:]] - out[inner])
    agreement.bring(0, 1, near, measure, share, out)
    np.testing.assert_allclose(out[inner], wanted, rtol=1e-5, atol=1e-6)


def test_what_is_found_hidden_makes_a_map_less_sure():
    doubts = doubt(np.array([0.0, 1.0, 3.0, 9.0], np.float32), 1.0)
    assert doubts[0] == 1
    assert (np.diff(doubts[:3]) > 0).all()
    assert doubts[3] == pytest.approx(float(doubt(np.array([5.0], np.float32), 1.0)[0]), rel=1e-5)
