"""The battery's door: what tunes gets no scene that is only reported on; and what it measures."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "battery"))

import catalogue
import measures


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
