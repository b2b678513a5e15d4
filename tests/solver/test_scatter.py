"""Noise that no amplitude tells, and how much is smoothed where it is dim."""

import numpy as np
import pytest

from solver import FusionOptions, fuse
from solver.preparation.prepare import exchange, prepare
from solver.preparation.scatter import scatter

RANGE = 7.5
ROWS, COLUMNS = 24, 32
NOISE, DARK = 0.01, 0.12
BOX = np.s_[6:18, 4:16]


def placed(frames: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    """Shifts (N, 2), and positions (N, H, W, 2)."""
    random = np.random.default_rng(seed)
    shifts = random.uniform(-0.5, 0.5, (frames, 2))
    shifts[0] = 0
    grid = np.moveaxis(np.indices((ROWS, COLUMNS)), 0, -1)
    return shifts, np.ascontiguousarray(grid + shifts[:, None, None], np.float32), random


def dark_box(frames: int, noise: float = NOISE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames of a dark flat box before a bright wall that an oblique edge ends, shifts and positions."""
    shifts, positions, random = placed(frames)
    row, column = positions[..., 0], positions[..., 1]
    corner, end = np.array([5.5, 3.5]), np.array([17.5, 15.5])
    inside = [
        np.clip(at - a + 0.5, 0, 1) * np.clip(b - at + 0.5, 0, 1)
        for at, a, b in zip((row, column), corner, end, strict=True)
    ]
    behind = np.clip(column + 0.4 * row - 32 + 0.5, 0, 1)
    distance = 2.4 + 0.5 * behind - 0.4 * inside[0] * inside[1]
    sigma = np.where(inside[0] * inside[1] > 0.5, noise * DARK / NOISE, noise)
    distance += sigma * random.normal(size=distance.shape)
    return distance.astype(np.float32), shifts, positions


@pytest.mark.parametrize("frames", [15, 40])
def test_the_noise_of_dark_things_is_told_by_the_frames_and_edges_are_no_noise(frames: int) -> None:
    distance, _, positions = dark_box(frames)
    found = scatter(distance, positions, NOISE, RANGE)
    assert np.median(found[8:16, 6:14]) == pytest.approx(DARK, rel=0.3)
    found[4:20, 2:18] = 0
    assert not found.any()


def test_a_phase_that_is_lost_is_told_as_well() -> None:
    _, positions, random = placed(15)
    distance = np.full((15, ROWS, COLUMNS), 2, np.float32)
    distance += 0.01 * random.normal(size=distance.shape).astype(np.float32)
    distance[:, :, 16:] = random.uniform(0, RANGE, (15, ROWS, 16))
    found = scatter(distance, positions, NOISE, RANGE)
    assert found[:, 19:].min() > RANGE / 12
    assert not found[:, :13].any()


def test_what_is_lit_is_less_noisy_than_an_empty_sky_of_which_the_usual_sample_is() -> None:
    shifts, positions, random = placed(15)
    distance = random.uniform(0, RANGE, (15, ROWS, COLUMNS)).astype(np.float32)
    lit = np.s_[:, 6:18, 4:20]
    distance[lit] = 2 + NOISE * random.normal(size=distance[lit].shape)
    found = scatter(distance, positions, 0.7, RANGE)
    assert np.median(found[9:15, 7:17]) == pytest.approx(NOISE, rel=0.3)
    options = FusionOptions(method="area")
    fused = fuse(distance, shifts=shifts, options=options, noise=0.7, ambiguity_range=RANGE)
    assert np.abs(fused.distance[36:60, 28:68] - 2).max() < NOISE


@pytest.mark.parametrize(("frames", "noise"), [(15, NOISE), (15, NOISE / 4), (40, NOISE)])
def test_without_amplitude_dark_things_are_better_than_in_one_frame(frames: int, noise: float) -> None:
    distance, shifts, _ = dark_box(frames, noise)
    errors = []
    for options in (FusionOptions(method="nearest"), FusionOptions(method="area")):
        found = fuse(distance, options=options, shifts=shifts, ambiguity_range=RANGE, noise=noise)
        errors.append(np.sqrt(np.mean((found.distance[28:68, 20:60] - 2.0) ** 2)))
    assert errors[1] < 0.15 * errors[0]


def test_a_frame_that_is_exchanged_has_the_deviations_of_where_it_looks() -> None:
    distance, _, positions = dark_box(15)
    options = FusionOptions(method="area")
    problem = prepare(distance, None, positions.copy(), options=options, ambiguity_range=RANGE, noise=NOISE)
    moved = positions[3] + np.array([0, 5], np.float32)
    exchange(problem, 3, distance[3], None, moved)
    assert (problem.sigma[3, 8:16, 2:9] > 5 * NOISE).all()
    assert (problem.sigma[3, 8:16, 14:20] == np.float32(NOISE)).all()


def test_more_frames_make_dim_ground_under_an_empty_sky_better() -> None:
    assert ground(60) < 0.65 * ground(15)


def ground(frames: int) -> float:
    """The RMS error of `area` on ground that runs away into the dark."""
    shifts, positions, random = placed(frames, 3)
    below = positions[..., 0] - 8
    true = np.where(below > 0, 1.5 + 24 / np.maximum(below + 6, 1), 0)
    light = np.where(below > 0, 12 * (2 / np.maximum(true, 1)) ** 3, 0)
    phasor = light * np.exp(2j * np.pi * true / RANGE)
    phasor += random.normal(size=phasor.shape) + 1j * random.normal(size=phasor.shape)
    distance = (np.angle(phasor) % (2 * np.pi) * RANGE / (2 * np.pi)).astype(np.float32)
    options = FusionOptions(method="area")
    noise = RANGE / (2 * np.pi)
    amplitude = np.abs(phasor).astype(np.float32)
    found = fuse(distance, amplitude, shifts=shifts, ambiguity_range=RANGE, noise=noise, options=options)
    rows = (np.arange(4 * ROWS) - 1.5) / 4 - 8
    seen = rows > 1
    off = found.distance[seen] - (1.5 + 24 / (rows[seen] + 6))[:, None]
    return float(np.sqrt(np.mean(off**2)))
