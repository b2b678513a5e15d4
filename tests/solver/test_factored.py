"""`phasor` on scenes of many kinds: print, thin bars, dark things, no return, better data."""

import cv2
import numba
import numpy as np
import pytest

from solver import Fused, FusionOptions, fuse
from solver.geometry.positions import sample_positions
from solver.methods.phasor import _run
from solver.optimisation.factored import Factored
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.schedule import SCHEDULE, Step
from solver.options import Footprint

RANGE, RAYS, MARGIN = 7.5, 8, 3
NOISE = 25.0  # counts, of each component
Y, X = (
    (np.arange((24 + 2 * MARGIN) * RAYS) + 0.5) / RAYS - MARGIN - 0.5,
    (np.arange((28 + 2 * MARGIN) * RAYS) + 0.5) / RAYS - MARGIN - 0.5,
)
ROW, COLUMN = np.meshgrid(Y, X, indexing="ij")


class Scene:
    """24 × 28 pixels of a field of distance (m) and light (counts), 8 × 8 rays each."""

    def __init__(self, distance, light, frames=12, noise=1.0, seed=0):
        rng = np.random.default_rng(seed)
        field = light * np.exp(2j * np.pi * distance / RANGE) * np.ones_like(ROW)
        self._distance = np.broadcast_to(distance, ROW.shape)
        self.truth = self.at(4)
        steps = rng.integers(-12, 13, (frames, 2))
        steps[0] = 0
        self.shifts = steps / RAYS
        stack = []
        for down, right in steps:
            top, left = MARGIN * RAYS + down, MARGIN * RAYS + right
            part = field[top : top + 24 * RAYS, left : left + 28 * RAYS]
            stack.append(part.reshape(24, RAYS, 28, RAYS).mean(axis=(1, 3)))
        noises = rng.normal(size=(2, frames, 24, 28))
        phasors = np.array(stack) + noise * NOISE * (noises[0] + 1j * noises[1])
        self.distance = np.mod(np.angle(phasors), 2 * np.pi) * RANGE / (2 * np.pi)
        self.amplitude = np.abs(phasors)
        self.noise = noise * NOISE * RANGE / (2 * np.pi)

    def at(self, factor):
        """The truth at another upsampling."""
        return self._cut(self._distance, factor)

    @staticmethod
    def _cut(field, factor):
        """The middle ray of each fused pixel."""
        step, edge = RAYS // factor, MARGIN * RAYS
        return field[edge : edge + 24 * RAYS, edge : edge + 28 * RAYS][step // 2 :: step, step // 2 :: step]

    def fused(self, method="phasor", **options) -> Fused:
        return fuse(
            self.distance,
            self.amplitude,
            shifts=self.shifts,
            ambiguity_range=RANGE,
            noise=self.noise,
            options=FusionOptions(method=method, **options),
        )

    def rms(self, method="phasor") -> float:
        return float(np.sqrt(np.nanmean((self.fused(method).distance - self.truth) ** 2)))


def dots(contrast):
    """Dots of 0.8 pixels, half of them dark."""
    ink = np.random.default_rng(3).random((60, 60)) < 0.5
    cells = ink[np.floor(ROW / 0.8).astype(int) + 20, np.floor(COLUMN / 0.8).astype(int) + 20]
    return np.where(cells, 3000 / contrast, 3000)


@pytest.mark.parametrize(("contrast", "most"), [(1.0, 1.5e-3), (3.0, 1.8e-3), (10.0, 3e-3)])
def test_print_on_a_flat_wall_stays_flat(contrast, most):
    scene = Scene(np.full_like(ROW, 2.0), dots(contrast))
    assert scene.rms() < most
    assert scene.rms() < 0.25 * scene.rms("nearest")


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(("contrast", "factor", "frames"), [(10.0, 2, 12), (30.0, 2, 12), (20.0, 4, 60)])
def test_dark_print_does_not_come_loose(contrast, factor, frames, seed):
    fused = Scene(np.full_like(ROW, 2.0), dots(contrast), frames=frames, seed=seed).fused(upsampling=factor)
    off = np.abs(fused.distance - 2)
    assert off.mean() < 1.5e-3
    assert off.max() < 0.4
    assert (off < np.maximum(0.06, fused.deviation)).all()


def test_a_dark_pole_stands_before_a_far_wall_where_pixels_are_not_divided():
    """It returns a twenty-fifth of the wall's light, two hundred deviations, and is a pixel wide."""
    pole = np.abs(COLUMN - 12) < 0.5
    scene = Scene(np.where(pole, 2.0, 4.0), np.where(pole, 120.0, 3000.0), noise=0.02)
    found = scene.fused(upsampling=1).distance[2:-2, 12]
    assert np.median(np.abs(found - 2)) < 0.05
    assert (np.abs(found - 2) > 0.5).mean() < 0.1


def test_many_frames_of_little_noise_are_fused_where_pixels_are_not_divided():
    random = np.random.default_rng(0)
    distance = (2 + 1e-7 * random.normal(size=(1200, 12, 12))).astype(np.float32)
    light, shifts = np.full_like(distance, 1000), random.uniform(-1, 1, (1200, 2))
    shifts[0] = 0
    options = FusionOptions(method="phasor", upsampling=1)
    given = {"ambiguity_range": RANGE, "noise": 1e-4, "options": options}
    assert np.abs(fuse(distance, light, shifts=shifts, **given).distance - 2).max() < 1e-3


@pytest.mark.parametrize("factor", [2, 3, 4, 8])
def test_a_smooth_thing_is_found_at_every_upsampling(factor):
    scene = Scene(2 + 0.03 * np.sin(ROW / 5) * np.cos(COLUMN / 6), 2500 + 500 * np.sin(COLUMN))
    found = scene.fused(upsampling=factor).distance
    exact = cv2.resize(scene.at(RAYS), (28 * factor, 24 * factor), interpolation=cv2.INTER_AREA)
    assert np.sqrt(np.mean((found - exact) ** 2)) < 3e-3


def test_a_dark_thing_before_a_bright_wall_stands_where_it_is():
    """It returns a twentieth of the wall's light, six times the noise of a sample."""
    inside = (np.abs(ROW - 12) < 4) & (np.abs(COLUMN - 14) < 5)
    scene = Scene(np.where(inside, 2.0, 2.4), np.where(inside, 150.0, 3000.0))
    error = np.abs(scene.fused().distance - scene.truth)
    assert error[40:56, 44:72].mean() < 0.045
    assert error.mean() < 0.02


def test_slanted_bars_of_one_pixel_keep_their_relief():
    bars = np.mod((COLUMN + ROW) / np.sqrt(2), 4) < 1
    scene = Scene(np.where(bars, 2.0, 2.3), np.full_like(ROW, 3000.0))
    found, front = scene.fused().distance, scene.truth < 2.15
    assert found[~front].mean() - found[front].mean() > 0.8 * 0.3


def test_where_nothing_comes_back_nothing_is_known_beyond_fill():
    inside = (ROW - 12) ** 2 + (COLUMN - 10) ** 2 < 36
    scene = Scene(np.full_like(ROW, 2.0), np.where(inside, 2500.0, 0.0))
    fused = scene.fused(fill=2.0)
    rows, columns = (np.arange(96) + 0.5) / 4 - 0.5, (np.arange(112) + 0.5) / 4 - 0.5
    radius = np.hypot(rows[:, None] - 12, columns - 10)
    assert np.abs(fused.distance[radius < 5.8] - 2.0).max() < 0.02
    assert np.isnan(fused.distance[radius > 9.5]).mean() > 0.95
    unknown = np.isnan(fused.distance)
    assert (fused.reason[unknown] == 2).all()
    assert (fused.reason[~unknown] <= 1).all()
    assert (fused.reason[radius < 5] == 0).all()


def test_what_is_unknown_says_why():
    scene = Scene(np.full_like(ROW, 2.0), np.full_like(ROW, 3000.0))
    scene.shifts = scene.shifts * 0
    scene.distance[:, :10] = np.nan
    scene.amplitude[:, :5] = 60000.0
    scene.amplitude[:, 5:10] = 3.0
    reason = scene.fused(fill=1.0).reason
    assert (reason[:16] == 3).all()
    assert (reason[24:34] == 2).all()
    assert (reason[44:] == 0).all()
    scene.shifts[:, 1] = 8.0
    scene.shifts[0] = 8.0
    assert (scene.fused(fill=1.0).reason[44:, :20] == 5).all()


@pytest.mark.parametrize("noise", [0.5, 1.0])
def test_truth_lies_within_one_deviation_as_often_as_it_should(noise):
    random = np.random.default_rng(7)
    light = 3000 * np.repeat(np.repeat(random.uniform(0.2, 1, (30, 34)), 8, axis=0), 8, axis=1)
    distance = 2 + 0.03 * np.sin(ROW / 5) * np.cos(COLUMN / 6) + np.where(COLUMN < 6, 0.4, 0)
    scene = Scene(distance, light, noise=noise)
    fused, away = scene.fused(), slice(36, None)
    error = np.abs(fused.distance - scene.truth)
    assert 0.5 < (error <= fused.deviation)[:, away].mean() < 0.87
    assert (error <= 2 * fused.deviation)[:, 24:32].mean() > 0.8


def test_what_is_bright_and_what_is_dim_lie_within_a_deviation_alike():
    bright = (np.abs(ROW - 11.5) < 8) & (np.abs(COLUMN - 9) < 8)
    distance = np.where(bright, 1.5 + 0.01 * ROW, 2.5 + 0.04 * COLUMN)
    within = []
    for seed in range(4):
        scene = Scene(distance, np.where(bright, 6000.0, 150.0), seed=seed)
        fused = scene.fused()
        exact = cv2.resize(scene.at(RAYS), (112, 96), interpolation=cv2.INTER_AREA)
        inside = np.abs(fused.distance - exact) <= fused.deviation
        within.append((inside[28:-28, 16:-56].mean(), inside[8:-8, -28:-4].mean()))
    near, far = np.mean(within, axis=0)
    assert 0.5 < near < 0.87
    assert 0.5 < far < 0.87


@pytest.mark.parametrize("noise", [0.5, 1.0])
@pytest.mark.parametrize("period", [20.0, 26.0])
def test_what_a_map_smooths_away_of_relief_is_in_its_deviation(period, noise):
    relief = 0.012 * np.sin(2 * np.pi * ROW / period) * np.cos(2 * np.pi * COLUMN / period)
    scene = Scene(2 + relief, np.full_like(ROW, 2500.0), noise=noise)
    fused = scene.fused()
    exact = cv2.resize(scene.at(RAYS), (112, 96), interpolation=cv2.INTER_AREA)
    within = np.abs(fused.distance - exact) <= fused.deviation
    assert 0.5 < within[8:-8, 8:-8].mean() < 0.87


def test_better_data_do_not_make_a_map_worse():
    random = np.random.default_rng(5)
    distance = np.where((ROW - 12) ** 2 + (COLUMN - 14) ** 2 < 40, 2.0, 2.5)
    light = 3000 * np.repeat(np.repeat(random.uniform(0.3, 1, (15, 17)), 16, axis=0), 16, axis=1)
    usual = Scene(distance, light).rms()
    assert Scene(distance, light, noise=0.25).rms() < 1.02 * usual
    assert Scene(distance, light, frames=40).rms() < 1.02 * usual


@pytest.mark.parametrize("noise", [0.25, 1.0])
def test_relief_as_fine_as_two_pixels_is_not_smoothed_away(noise):
    field = np.random.default_rng(2).normal(size=ROW.shape).astype(np.float32)
    relief = cv2.GaussianBlur(field, (0, 0), 1.5 * RAYS)
    scene = Scene(2 + 0.02 * relief / relief.std(), np.full_like(ROW, 2500.0), noise=noise)
    exact = cv2.resize(scene.at(RAYS), (112, 96), interpolation=cv2.INTER_AREA)
    fused = scene.fused()
    off = np.abs(fused.distance - exact)[8:-8, 8:-8]
    assert off.mean() < (0.0012 if noise < 1 else 0.0029)
    assert 0.5 < (off <= fused.deviation[8:-8, 8:-8]).mean() < 0.9


@pytest.mark.parametrize("period", [2.5, 3.5, 6.0])
def test_waves_of_a_few_pixels_are_not_flattened(period):
    waves = 0.008 * np.sin(2 * np.pi * (COLUMN + 0.4 * ROW) / period)
    scene = Scene(2 + waves, np.full_like(ROW, 2500.0), noise=0.25)
    exact = cv2.resize(scene.at(RAYS), (112, 96), interpolation=cv2.INTER_AREA)
    assert np.abs(scene.fused().distance - exact)[8:-8, 8:-8].mean() < 0.5 * np.abs(waves).mean()


def test_relief_of_a_tenth_of_a_samples_noise_is_found_where_noise_is_little():
    field = np.random.default_rng(2).normal(size=ROW.shape).astype(np.float32)
    relief = cv2.GaussianBlur(field, (0, 0), 1.5 * RAYS)
    scene = Scene(2 + 0.004 * relief / relief.std(), np.full_like(ROW, 2500.0), noise=1 / 16)
    exact = cv2.resize(scene.at(RAYS), (112, 96), interpolation=cv2.INTER_AREA)
    assert np.abs(scene.fused().distance - exact)[8:-8, 8:-8].mean() < 0.3e-3


def test_a_bright_thing_has_no_rings_however_little_noise_there_is():
    inside = (ROW - 12.3) ** 2 + (COLUMN - 14.1) ** 2 < 6
    walls = np.where(inside, 2.0, 2.4 + 0.004 * COLUMN)
    usual, quiet = (Scene(walls, np.where(inside, 30000.0, 1200.0), noise=noise).rms() for noise in (1, 0.25))
    assert quiet < 1.2 * usual < 0.05


def test_a_numeric_strength_is_a_factor_of_which_one_is_auto():
    scene = Scene(2.0 + 0.01 * COLUMN, np.full_like(ROW, 1000.0))
    auto, one, strong = (scene.fused(regularization=r) for r in ("auto", 1.0, 20.0))
    np.testing.assert_array_equal(auto.distance, one.distance)
    assert auto.report.regularization == one.report.regularization == 1.0
    assert auto.report.gap is None
    assert np.std(np.diff(strong.distance, n=2)) < 0.7 * np.std(np.diff(auto.distance, n=2))


def test_too_few_iterations_are_said_so():
    scene = Scene(np.full_like(ROW, 2.0), np.full_like(ROW, 1000.0))
    with pytest.warns(match="max_iterations"):
        fused = scene.fused(max_iterations=20)
    assert fused.report.iterations == 20
    assert not fused.report.converged


def test_every_step_is_another_one_though_some_are_equal(monkeypatch):
    taken = []
    monkeypatch.setattr(
        Factored, "descend", lambda _, step, limit: taken.append(step) or min(step.rounds, limit)
    )
    scene = Scene(np.full_like(ROW, 2.0), np.full_like(ROW, 1000.0))
    begun = course(scene)
    equal = [Step(2.0, 14)] * 3
    assert _run(begun, equal, 14, None, False) == (14, False)
    assert _run(begun, equal, 42, None, False) == (42, True)
    assert len(taken) == 4


def course(scene):
    phase = scene.distance * 2 * np.pi / RANGE
    values = np.stack([np.cos(phase), np.sin(phase)]) * scene.amplitude / 3000
    positions = sample_positions(scene.distance.shape, shifts=scene.shifts)
    weights = np.ones(scene.distance.shape, np.float32)
    term = AreaTerm(values.astype(np.float32), weights, positions, 4, Footprint(), margin=16)
    return Factored(term, 3000.0, 1 / (NOISE / 3000) ** 2, NOISE / 3000 / 12**0.5, 0.3)


def test_sharp_steps_lower_the_objective():
    scene = Scene(np.where(COLUMN < 14.2, 2.0, 2.5), dots(3.0))
    descent = course(scene)
    for step in SCHEDULE:
        descent.descend(step, 1000)
    before = descent.objective()
    for _ in range(4):
        descent.descend(Step(1.0, 40), 1000)
    assert descent.objective() < before


def test_any_number_of_threads_gives_the_same_bits():
    scene = Scene(np.where(COLUMN < 14.2, 2.0, 2.5), dots(3.0))
    states = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        descent = course(scene)
        for step in SCHEDULE[:4]:
            descent.descend(step, 100)
        states.append(descent.state.copy())
    np.testing.assert_array_equal(*states)
