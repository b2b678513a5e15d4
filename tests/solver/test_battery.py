"""The battery's door: what tunes gets no scene that is only reported on; and what it measures."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "battery"))

import catalogue
import measures
import rig
import table

from solver import FusionOptions, fuse


@pytest.mark.parametrize("name", list(catalogue.REPORTED))
def test_a_scene_that_is_only_reported_on_cannot_be_tuned_with(name):
    with pytest.raises(ValueError, match="only reported on"):
        catalogue.to_tune(name)
    assert catalogue.to_report(name).surfaces


@pytest.mark.parametrize("name", list(catalogue.TUNING))
def test_the_others_can(name):
    assert catalogue.to_tune(name).surfaces


def test_there_are_scenes_of_many_kinds_and_none_in_both_sets():
    assert len(catalogue.SCENES) >= 14
    assert not set(catalogue.TUNING) & set(catalogue.REPORTED)


def test_an_unknown_cell_counts_half_a_metre_and_a_whole_range_nothing():
    truth = np.array([[2.0, 2.0, np.nan, 0.1]], np.float32)
    found = np.array([[np.nan, 2.25, 1.0, 7.6]], np.float32)
    np.testing.assert_allclose(measures.wrong(found, truth, 7.5), [[0.5, 0.25, np.nan, 0.0]], atol=1e-6)


@pytest.fixture(scope="module", params=["net", "boxes"])
def view(request):
    return rig.look(catalogue.to_tune(request.param), (4,))


@pytest.mark.parametrize("amplitude", [True, False])
@pytest.mark.parametrize("noise", [1.0, 0.25])
def test_auto_errs_least_in_the_mean_and_area_less_than_one_frame(view, amplitude, noise):
    burst = rig.capture(view, rig.Condition(frames=10, noise=noise, amplitude=amplitude), 0)
    errors = {}
    for method in ("nearest", "lidarboost", "area", "auto"):
        found = fuse(options=FusionOptions(method=method), **burst.given)
        off = measures.wrong(found.distance, view.truth[4], rig.RANGE)
        errors[method] = np.array([np.sqrt(np.nanmean(off**2)), np.nanmean(off)])
    assert found.report.method == ("phasor" if amplitude else "area")
    assert (errors["area"] < 0.85 * errors["nearest"]).all()
    assert errors["area"][1] < 0.85 * errors["lidarboost"][1]
    if amplitude:
        assert (errors["auto"] < 0.95 * errors["area"]).all()


@pytest.fixture(scope="module")
def stored():
    folder = Path(catalogue.__file__).parents[1] / "results"
    sets = (json.loads((folder / f"{name}.json").read_text()) for name in ("tuning", "reported"))
    return [row for found in sets for row in found["rows"]]


@pytest.mark.parametrize("condition", ["base", "noise/4", "N=60"])
def test_on_no_scene_was_area_found_to_err_more_than_one_frame(stored, condition):
    ratios = table.against_nearest(stored, condition, "area")
    assert set(ratios) == set(catalogue.SCENES)
    assert np.max(list(ratios.values())) < 0.85


@pytest.mark.parametrize("condition", ["noise/4", "N=60"])
def test_on_no_scene_was_the_default_found_to_err_more_with_better_data(stored, condition):
    found = table.rises(stored, condition, "phasor")
    assert set(found) == set(catalogue.SCENES)
    assert max(found.values()) < 1.02
