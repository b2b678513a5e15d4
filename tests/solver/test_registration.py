"""Registration finds known displacements and rotations, and says what it could not place."""

import functools
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest

from solver.errors import FusionInputError, RegistrationError
from solver.evaluation import LITERAL, MATCHED, DepthMap, make_trial, procedural_object
from solver.geometry.points import rotations_to_shifts
from solver.geometry.positions import rotation_matrix, sample_positions
from solver.registration import Track, register

SHARED = Path(__file__).parents[3] / "shared" / "data"


@functools.cache
def lantern() -> DepthMap:
    return DepthMap(procedural_object(), oversampling=2)


def error(found, shifts):
    return float(np.sqrt(np.mean((found.shifts - shifts)[1:] ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("variance", sorted({*LITERAL, *MATCHED}))
def test_displacements_of_the_built_in_object(variance):
    trial = make_trial(lantern(), variance=variance, seed=3, span=3)
    found = register(trial.distance)
    assert not found.rejected
    assert found.rotations is None
    assert error(found, trial.shifts) < 0.02


@pytest.mark.skipif(not (SHARED / "bunny_depth.npz").exists(), reason="needs shared data")
@pytest.mark.parametrize("variance", sorted({*LITERAL, *MATCHED}))
def test_displacements_of_the_papers_kind_of_object(variance):
    with np.load(SHARED / "bunny_depth.npz") as data:
        depth = DepthMap(data["fine"], oversampling=4)
    errors = []
    for seed in range(4):  # a single burst may be unlucky by half
        trial = make_trial(depth, variance=variance, seed=seed, span=3)
        errors.append(error(register(trial.distance), trial.shifts))
    assert np.sqrt(np.mean(np.square(errors))) < 0.012


def test_displacements_up_to_a_quarter_of_the_image_need_no_first_guess():
    trial = make_trial(lantern(), variance=0.7, seed=5, span=11)
    found = register(trial.distance)
    assert not found.rejected
    assert error(found, trial.shifts) < 0.04


def test_the_uncertainty_is_of_the_size_of_the_error():
    errors, stated = [], []
    for seed in range(4):
        trial = make_trial(lantern(), variance=46.3, seed=seed)
        found = register(trial.distance)
        errors.append(error(found, trial.shifts))
        stated.append(np.sqrt(np.mean(found.uncertainty[1:] ** 2)))
        assert (found.uncertainty[0] == 0).all()
    assert 0.3 < np.mean(errors) / np.mean(stated) < 3


def test_the_unit_of_distance_does_not_matter():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    plain = register(trial.distance).shifts
    assert np.allclose(register(trial.distance * 1e-6).shifts, plain, atol=1e-3)
    assert np.allclose(register(trial.distance * 1e8).shifts, plain, atol=1e-3)


def test_any_frame_can_be_the_reference():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    found = register(trial.distance, reference=4)
    assert np.abs(found.shifts - (trial.shifts - trial.shifts[4])).max() < 0.06
    assert (found.shifts[4] == 0).all()


def test_missing_pixels_and_outliers_do_not_matter():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    random = np.random.default_rng(0)
    distance = trial.distance.copy()
    distance[random.random(distance.shape) < 0.02] = 0
    distance[random.random(distance.shape) < 0.1] = np.nan
    distance[:, 20:30, 5:15] = np.nan
    found = register(distance)
    assert not found.rejected
    assert error(found, trial.shifts) < 0.08


def test_frames_that_show_something_else_are_rejected_and_named():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    distance = trial.distance.copy()
    distance[3] = np.random.default_rng(0).normal(90, 30, distance[3].shape)
    distance[5] = distance[5, ::-1]
    distance[7] = np.nan
    found = register(distance)
    assert sorted(found.rejected) == [3, 5, 7]
    assert "fit" in found.rejected[3]
    assert "valid" in found.rejected[7]
    kept = [k for k in range(len(distance)) if k not in found.rejected]
    assert np.abs(found.shifts - trial.shifts)[kept].max() < 0.06
    assert np.isfinite(found.shifts).all()


def test_a_wrong_first_guess_is_only_a_guess():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    found = register(trial.distance, initial=trial.shifts + 6)
    assert error(found, trial.shifts) < 0.03


def test_the_first_guess_decides_where_the_frames_say_nothing():
    guess = np.array([[0, 0], [1.5, -2.0], [-3, 0.5]])
    found = register(np.full((3, 32, 32), 2.0), initial=guess)
    assert np.allclose(found.shifts, guess)
    assert (found.uncertainty[1:] > 1).all()
    assert np.allclose(register(np.full((3, 32, 32), 2.0)).shifts, 0)


def test_one_frame_is_at_rest():
    found = register(np.ones((1, 8, 8)), intrinsics=np.diag([20.0, 20, 1]))
    assert (found.shifts == 0).all()
    assert found.rotations is not None
    assert (found.rotations == 0).all()


def test_an_empty_reference_and_frames_that_all_fail_raise():
    trial = make_trial(lantern(), variance=0.7, seed=2, frames=3)
    distance = trial.distance.copy()
    distance[0] = np.nan
    with pytest.raises(RegistrationError, match="frame 0"):
        register(distance)
    assert sorted(register(distance, reference=1).rejected) == [0]


@pytest.mark.parametrize("blank", ["dark", "even"])
def test_a_reference_without_light_or_contrast_raises(blank):
    _, distance, amplitude = turned()
    distance, amplitude = distance.copy(), amplitude.copy()
    distance[0], amplitude[0] = (distance[0], 0) if blank == "dark" else (2, 0.5)
    with pytest.raises(RegistrationError, match="frame 0, the reference, cannot be used: it has no light"):
        register(distance, amplitude, intrinsics=K, ambiguity_range=RANGE)
    assert sorted(register(distance, amplitude, reference=1, ambiguity_range=RANGE).rejected) == [0]


def test_a_plain_wall_of_noise_stays_at_rest():
    wall = np.random.default_rng(0).normal(2, 0.01, (4, 72, 88))
    light = np.random.default_rng(1).normal(1, 0.01, wall.shape)
    for amplitude in (None, light):
        found = register(wall, amplitude, ambiguity_range=RANGE)
        assert not found.rejected
        assert np.abs(found.shifts).max() < 0.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"distance": np.ones((4, 4))}, r"expected \(N, H, W\)"),
        ({"initial": np.zeros((3, 2))}, r"expected \(2, 2\)"),
        ({"initial": np.full((2, 2), np.nan)}, "NaN"),
        ({"initial": np.zeros((2, 3))}, "intrinsics"),
        ({"reference": 2}, "reference"),
        ({"source": "both"}, "amplitude"),
    ],
)
def test_bad_input_is_named(arguments, words):
    with pytest.raises(FusionInputError, match=words):
        register(**{"distance": np.ones((2, 24, 24)), **arguments})


# A camera that turns before a panorama of phasors: planes at different depths with prints and gaps.

K = np.array([[110.0, 0, 43.5], [0, 110.0, 35.5], [0, 0, 1]])
SHAPE, FINE, RANGE = (72, 88), 8, 7.5


def panorama(x, y):
    """Distance and amplitude of the ray (x, y, 1)."""
    depth, light = np.full(x.shape, 4.0), 0.5 + 0.3 * np.sign(np.sin(25 * x) * np.sin(21 * y + 0.4))
    for left, top, size, near, print_ in (
        (-0.30, -0.25, 0.22, 1.6, 14.0),
        (0.05, -0.10, 0.30, 2.2, 30.0),
        (-0.22, 0.08, 0.18, 2.9, 0.0),
        (0.22, -0.33, 0.10, 1.3, 0.0),
    ):
        inside = (x > left) & (x < left + size) & (y > top + 0.1 * x) & (y < top + 0.8 * size)
        inside &= ~(np.hypot(x - left - size / 2, y - top - size / 3) < size / 6)
        depth = np.where(inside, near, depth)
        light = np.where(inside, 0.6 + 0.3 * np.cos(print_ * (x + y)), light)
    return depth, light / depth**2


def burst(turns, noise, seed=0):
    """Frames (distance, amplitude) of 8 × 8 rays per pixel, averaged as phasors."""
    rows, columns = SHAPE
    r, c = np.meshgrid(np.arange(rows * FINE), np.arange(columns * FINE), indexing="ij")
    rays = np.stack(
        [((c + 0.5) / FINE - 0.5 - K[0, 2]) / K[0, 0], ((r + 0.5) / FINE - 0.5 - K[1, 2]) / K[1, 1]]
    )
    rays = np.concatenate([rays, np.ones((1, *r.shape))])
    frames = []
    for turn in turns:
        x, y, z = np.einsum("ij,jrc->irc", rotation_matrix(turn), rays)
        depth, light = panorama(x / z, y / z)
        phasor = light * np.exp(2j * np.pi * depth * np.sqrt(1 + (x / z) ** 2 + (y / z) ** 2) / RANGE)
        frames.append(phasor.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3)))
    y = np.array(frames)
    random = np.random.default_rng(seed)
    y = y + noise * (random.normal(size=y.shape) + 1j * random.normal(size=y.shape))
    return np.mod(np.angle(y), 2 * np.pi) * RANGE / (2 * np.pi), np.abs(y)


@functools.cache
def turned():
    random = np.random.default_rng(4)
    turns = np.column_stack([random.uniform(-0.06, 0.06, (8, 2)), random.uniform(-0.01, 0.01, 8)])
    turns[0] = 0
    return turns, *burst(turns, noise=0.001)


def rotation_error(found, turns):
    have = sample_positions((len(turns), *SHAPE), rotations=found, intrinsics=K)
    want = sample_positions((len(turns), *SHAPE), rotations=turns, intrinsics=K)
    return float(np.sqrt(np.mean((have - want)[1:] ** 2)))


@pytest.mark.parametrize("guided", [False, True])
def test_rotations_of_a_calibrated_camera(guided):
    turns, distance, amplitude = turned()
    guess = turns + np.random.default_rng(1).normal(0, 0.004, turns.shape) if guided else None
    found = register(distance, amplitude, intrinsics=K, initial=guess, ambiguity_range=RANGE)
    assert not found.rejected
    assert rotation_error(found.rotations, turns) < 0.02
    assert np.abs(found.shifts - rotations_to_shifts(turns, SHAPE, K))[1:].max() < 0.04


@pytest.mark.parametrize("source", ["distance", "amplitude", "both"])
def test_rotations_from_distance_amplitude_or_both_without_an_ambiguity_range(source):
    turns, distance, amplitude = turned()
    found = register(distance, amplitude, intrinsics=K, source=source)
    assert rotation_error(found.rotations, turns) < 0.03


def test_rotations_from_distance_alone():
    turns, distance, _ = turned()
    assert rotation_error(register(distance, None, intrinsics=K).rotations, turns) < 0.04


@pytest.mark.parametrize("source", ["distance", "both"])
def test_the_number_of_threads_does_not_matter(source):
    _, distance, amplitude = turned()
    threads, found = (numba.get_num_threads(), cv2.getNumThreads()), []
    try:
        for count in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(count)
            cv2.setNumThreads(count)
            found.append(register(distance, amplitude, intrinsics=K, ambiguity_range=RANGE, source=source))
    finally:
        numba.set_num_threads(threads[0])
        cv2.setNumThreads(threads[1])
    one, all_ = found
    assert np.abs(one.rotations - all_.rotations).max() * K[0, 0] < 1e-6
    assert np.allclose(one.uncertainty, all_.uncertainty, rtol=1e-5)


def test_uneven_lighting_that_turns_with_the_camera_does_not_pull():
    turns, distance, amplitude = turned()
    rows, columns = np.indices(SHAPE)
    falloff = 1 / (1 + ((rows - 36) ** 2 + (columns - 44) ** 2) / 80**2)
    found = register(distance, amplitude * falloff, intrinsics=K, ambiguity_range=RANGE)
    assert rotation_error(found.rotations, turns) < 0.03


def test_along_a_plain_wall_the_first_guess_stands_and_the_uncertainty_says_so():
    random = np.random.default_rng(0)
    shifts = np.array([[0, 0], [1.5, -2.0], [-2.5, 1.0], [0.5, 3.0]])
    rows = np.indices((72, 88))[0] + shifts[:, 0, None, None]
    wall = 2 + 0.04 * rows + random.normal(0, 0.01, (4, 72, 88))
    guess = shifts + np.array([[0, 0], [0.4, 0.3], [-0.4, 0.2], [0.3, -0.4]])
    found = register(wall, initial=guess)
    assert not found.rejected
    assert np.abs(found.shifts[:, 1] - guess[:, 1]).max() < 0.1  # nothing to see along the rows
    assert np.abs(found.shifts[:, 0] - shifts[:, 0]).max() < 0.3  # the slope shows the rest
    assert (found.uncertainty[1:, 1] > 1).all()
    assert (found.uncertainty[1:, 0] < 0.3).all()


def test_a_long_track_does_not_drift():
    trial = make_trial(lantern(), variance=0, seed=2)
    track = Track(10)
    for frame, shift in zip(trial.distance, trial.shifts, strict=True):
        track.add(frame, None, shift)
    rounds = []
    for _ in range(40):
        found = [
            track.follow(frame, None, shift)
            for frame, shift in zip(trial.distance, trial.shifts, strict=True)
        ]
        rounds.append(np.mean(found - trial.shifts, axis=0))
    assert np.abs(rounds[-1] - rounds[0]).max() < 0.015


def test_a_track_is_the_same_with_any_number_of_threads():
    trial = make_trial(lantern(), variance=0.7, seed=2)
    threads, found = numba.get_num_threads(), []
    try:
        for count in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(count)
            track = Track(5)
            for frame, shift in zip(trial.distance[:4], trial.shifts, strict=False):
                track.add(frame, None, shift)
            found.append([track.follow(frame, None, np.zeros(2)) for frame in trial.distance[4:]])
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)
    assert np.abs(found[0] - trial.shifts[4:]).max() < 0.06
