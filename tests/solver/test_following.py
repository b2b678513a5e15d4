"""Streams without poses: each frame is placed by those before it."""

import numpy as np
import pytest
from made_streams import COLUMNS, ROWS, long_stream

from solver import FusionOptions, RegistrationError, SlidingFusion
from solver.evaluation import DepthMap, make_trial, procedural_object


def test_a_stream_without_guesses_follows_the_frames_and_does_not_drift() -> None:
    trial = make_trial(DepthMap(procedural_object(), oversampling=2), variance=0.7, seed=2)
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=10)
    for _ in range(4):
        fused = [sliding.push(frame) for frame in trial.distance]
    assert np.sqrt(np.mean((fused[-1].shifts - trial.shifts) ** 2)) < 0.03


def test_a_frame_that_fits_none_leaves_a_stream_as_it_was() -> None:
    trial = make_trial(DepthMap(procedural_object(), oversampling=2), variance=0.7, seed=2)
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=10)
    for frame in trial.distance[:8]:
        sliding.push(frame)
    with pytest.raises(RegistrationError, match="frame 8 does not fit"):
        sliding.push(trial.distance[8, ::-1])
    fused = sliding.push(trial.distance[8])
    assert np.abs(fused.shifts[-1] - trial.shifts[8]).max() < 0.05


def test_a_stream_starts_over_where_the_scene_is_another_one() -> None:
    trial = make_trial(DepthMap(procedural_object(), oversampling=2), variance=0.7, seed=2)
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=10)
    for frame in trial.distance[:8]:
        sliding.push(frame)
    for frame in trial.distance[:4]:
        with pytest.raises(RegistrationError, match="frame 8 does not fit"):
            sliding.push(frame[::-1])
    anew = sliding.push(trial.distance[4, ::-1])
    assert anew.report.used == (8,)
    assert "started over at frame 8" in anew.report.notes[0]
    assert sliding.push(trial.distance[5, ::-1]).report.used == (8, 9)


@pytest.mark.parametrize("blank", ["dark", "even", "empty"])
def test_a_stream_does_not_begin_with_a_frame_that_shows_nothing(blank: str) -> None:
    distance, amplitude, shifts = long_stream(14)
    few = np.full_like(distance[0], np.nan)
    few[3, 3] = 2
    blanks = {
        "dark": (distance[0], 0 * amplitude[0]),
        "even": (np.full_like(distance[0], 2), amplitude[0]),
        "empty": (few, amplitude[0]),
    }
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=8, ambiguity_range=7.5)
    with pytest.raises(RegistrationError, match="begin with one that shows the scene"):
        sliding.push(*blanks[blank])
    found = [sliding.push(frame, light).shifts[-1] for frame, light in zip(distance, amplitude, strict=True)]
    assert np.abs(found[7] - shifts[7]).max() < 0.1
    # Nor does it start over with one, however many there are.
    for _ in range(6):
        with pytest.raises(RegistrationError):
            sliding.push(*blanks[blank])
    assert sliding.push(distance[13], amplitude[13]).report.used == (7, 8, 9, 10, 11, 12, 13, 14)


@pytest.mark.parametrize("lit", [False, True])
def test_a_stream_of_a_plain_wall_stays_at_rest(lit: bool) -> None:
    rng = np.random.default_rng(0)
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=8, ambiguity_range=7.5)
    for _ in range(20):
        light = rng.normal(1000, 5, (ROWS, COLUMNS)) if lit else None
        fused = sliding.push(rng.normal(2, 0.005, (ROWS, COLUMNS)), light)
        assert np.abs(fused.shifts).max() < 1


@pytest.mark.parametrize("window", [1, 3])
def test_frames_of_a_short_window_do_not_drift(window: int) -> None:
    distance, amplitude, shifts = long_stream(80)
    sliding = SlidingFusion(FusionOptions(method="shift-and-add"), window=window, ambiguity_range=7.5)
    found = [sliding.push(frame, light).shifts[-1] for frame, light in zip(distance, amplitude, strict=True)]
    off = np.array(found) - shifts
    # One after the other alone they would be as far off as the errors of all before sum up to.
    assert np.sqrt(np.mean(off[-20:] ** 2)) < 0.05
    assert np.sqrt(np.mean(off[-20:] ** 2)) < 1.5 * np.sqrt(np.mean(off[1:21] ** 2))


def test_codes_for_invalid_pixels_misplace_no_frame_of_a_stream() -> None:
    distance, _, shifts = long_stream(12)
    distance[np.random.default_rng(1).random(distance.shape) < 0.02] = 65535
    sliding = SlidingFusion(FusionOptions(method="lidarboost"), window=12)
    for frame, shift in zip(distance, shifts, strict=True):
        fused = sliding.push(frame, initial=shift)
    assert np.abs(fused.shifts - shifts).max() < 0.3
    assert np.nanmax(fused.distance) < 3
