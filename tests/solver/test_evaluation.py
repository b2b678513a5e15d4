"""The paper's protocol, its measures, and what the experiments must show."""

import functools

import numpy as np
import pytest

from solver.errors import FusionInputError
from solver.evaluation import (
    MATCHED,
    DepthMap,
    Region,
    Setting,
    compare,
    errors,
    make_trial,
    percent_of_longest_side,
    procedural_object,
)
from solver.evaluation.ablations import VARIANTS, ablate
from solver.evaluation.variants import compare_ablations, dark_print


@functools.cache
def lantern():
    return DepthMap(procedural_object(), oversampling=2)


def small():
    return DepthMap(np.random.default_rng(0).uniform(1, 3, (96, 112)), rescale=False)


def test_the_built_in_object_is_about_as_hard_as_the_papers():
    depth = procedural_object()
    assert depth.min() == 0
    assert depth.max() == 182
    assert 0.2 < np.mean(depth < 182) < 0.6
    trial = make_trial(lantern(), variance=0, seed=0)
    assert trial.truth.shape == (200, 200)
    assert trial.distance.shape == (10, 50, 50)
    frame = trial.distance[0].repeat(4, axis=0).repeat(4, axis=1)
    assert 120 < errors(frame, trial.truth).mse < 260


def test_a_frame_at_whole_pixels_is_the_mean_of_its_block():
    depth = small()
    image = depth.image
    frame = depth.frame((2, -1), upsampling=4)
    assert frame.shape == (12, 14)
    assert frame[3, 5] == pytest.approx(image[40:48, 32:40].mean())


def test_a_frame_between_pixels_weighs_them_by_their_overlap():
    depth = small()
    frame = depth.frame((0.0625, 0), upsampling=4)  # half a pixel of the map
    rows = np.array([0.5, *[1] * 7, 0.5])
    expected = (depth.image[24:33, 40:48] * rows[:, None]).sum() / 64
    assert frame[3, 5] == pytest.approx(expected)


def test_beyond_its_edges_the_map_repeats():
    depth = DepthMap(np.arange(96.0)[:, None] * np.ones((1, 96)), rescale=False)
    frame = depth.frame((-20, 0), upsampling=4)
    assert np.allclose(frame, 0)
    assert np.allclose(depth.frame((20, 3), upsampling=4), 95)


def test_truth_is_the_mean_over_fused_pixels_and_noise_adds_its_variance():
    depth = small()
    trial = make_trial(depth, variance=9.0, seed=1, frames=40)
    assert trial.truth[2, 3] == pytest.approx(depth.image[4:6, 6:8].mean())
    clean = make_trial(depth, variance=0, seed=1, frames=40)
    assert np.var(trial.distance - clean.distance) == pytest.approx(9, rel=0.05)
    assert np.array_equal(make_trial(depth, variance=9.0, seed=1, frames=40).distance, trial.distance)
    assert (trial.shifts[0] == 0).all()


def test_any_map_is_brought_to_the_papers_range_and_unknown_depth_is_background():
    image = np.random.default_rng(0).uniform(2, 5, (40, 40))
    image[5:9, 5:9] = np.nan
    depth = DepthMap(image)
    assert depth.image.min() == 0
    assert depth.image.max() == pytest.approx(182)
    assert np.allclose(depth.image[5:9, 5:9], 182)


@pytest.mark.parametrize("bad", [np.ones((40, 40)), np.full((40, 40), np.nan), np.ones(40), np.eye(8)])
def test_a_map_without_relief_or_too_small_is_refused(bad):
    with pytest.raises(FusionInputError):
        DepthMap(bad)


def test_a_region_crops_frames_and_truth_alike():
    region = Region(top=2, left=3, height=5, width=6)
    whole, part = (
        make_trial(small(), variance=0, seed=4),
        make_trial(small(), variance=0, seed=4, region=region),
    )
    assert np.array_equal(part.distance, whole.distance[:, 2:7, 3:9])
    assert np.array_equal(part.truth, whole.truth[8:28, 12:36])
    with pytest.raises(FusionInputError, match="region"):
        make_trial(small(), variance=0, seed=4, region=Region(10, 0, 5, 5))


def test_errors_count_known_pixels_only():
    truth = np.zeros((4, 5), np.float32)
    fused = np.full_like(truth, 2)
    fused[0] = np.nan
    found = errors(fused, truth)
    assert (found.mse, found.rmse, found.mae, found.coverage) == (4, 2, 2, 0.75)
    with pytest.raises(FusionInputError):
        errors(fused, truth[:3])
    with pytest.raises(FusionInputError):
        errors(np.full_like(truth, np.nan), truth)


def test_percent_is_of_the_objects_longest_side():
    truth = np.full((60, 60), 100, np.float32)
    truth[10:20, 5:55] = 90
    assert percent_of_longest_side(truth + 1, truth, pitch=2)[0, 0] == pytest.approx(1)  # 50 pixels of 2
    truth[10, 5] = -100
    assert percent_of_longest_side(truth + 1, truth, pitch=2)[0, 0] == pytest.approx(100 / 190)


def test_fusion_beats_one_frame_and_area_beats_lidarboost():
    found = compare(Setting(lantern()), ("lidarboost", "area"), MATCHED[1:2], [0])
    by_method = {outcome.method: outcome for outcome in found}
    assert by_method["lidarboost"].relative < 0.65
    assert by_method["area"].mse < 0.5 * by_method["lidarboost"].mse
    assert by_method["area"].registration < 0.03
    assert by_method["area"].coverage == 1


def test_every_lambda_is_run_and_named():
    setting = Setting(lantern(), frames=4, region=Region(10, 10, 24, 24), exact_shifts=True)
    told = []
    found = compare(setting, ("mrf",), (0.7,), (0, 1), lambdas=(0.1, 2.0), told=told.append)
    assert [(row.seed, row.regularization) for row in found] == [(0, 0.1), (0, 2.0), (1, 0.1), (1, 2.0)]
    assert all(row.registration == 0 for row in found)
    assert len(told) == 4


def test_the_papers_choices_are_the_best_of_the_ablations():
    setting = Setting(lantern(), region=Region(10, 10, 20, 20))
    found = compare_ablations(setting, (4.1,), (0,))
    mse = {outcome.method: outcome.mse for outcome in found}
    for other in ("interpolated resampling", "separate norms"):
        assert mse["lidarboost"] < mse[other]
    assert mse["lidarboost"] < 1.1 * mse["absolute data term"]
    assert mse["with amplitude threshold"] < mse["without amplitude threshold"]


def test_the_ablations_plain_variant_is_the_methods_own_objective():
    from solver import FusionOptions, fuse

    setting = Setting(lantern(), region=Region(12, 12, 20, 20))
    trial = setting.trial(4.1, 0)
    options = FusionOptions(method="lidarboost", regularization=7.0, tolerance=1e-5, max_iterations=5000)
    whole = fuse(trial.distance, options=options, shifts=trial.shifts).distance
    plain = ablate(trial, VARIANTS[0], 7.0, 4)
    known = np.isfinite(whole)
    assert np.abs(plain - whole)[known].mean() < 0.15


def test_the_dark_print_is_noisier_by_the_noise_law():
    setting = Setting(lantern())
    printed, clean = dark_print(setting, 4.1, 0), setting.trial(0, 0)
    noise = printed.trial.distance - clean.distance
    dark = printed.amplitude < 1
    assert np.std(noise[dark]) / np.std(noise[~dark]) == pytest.approx(12, rel=0.1)
