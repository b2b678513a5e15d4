from dataclasses import replace

import numpy as np
import pytest
from rendered import Studio, with_error
from scipy.spatial.transform import Rotation

from drivers.calibration import Corrections, CyclicTerm, sr3000_calibration
from drivers.simulation.scene import plate
from drivers.simulation.scenes import SCENES
from service.calibration.distance import calibrate_distance
from service.errors import CalibrationError

CAMERA = sr3000_calibration()
RANGE = 7.5
PATTERN = 0.02 * np.random.default_rng(3).standard_normal(CAMERA.shape)
PATTERN -= PATTERN.mean()
CYCLIC = CyclicTerm(amplitude=0.03, harmonic=4, phase=1.1)
TRUE = Corrections(constant=0.12, cyclic=(CYCLIC,), per_pixel=tuple(map(tuple, PATTERN.tolist())))


def wall(distance, yaw=0.0, count=4, seed=0, error=None):
    """Frames of a wall at a perpendicular distance, turned by `yaw` degrees."""
    normal = Rotation.from_euler("y", yaw, degrees=True).apply((0.0, 0.0, -1.0))
    studio = Studio([plate(-distance * normal, 40, 40, 0.7, normal=normal)], CAMERA, seed)
    frames = [studio.frame() for _ in range(count)]
    return [with_error(frame, error or true_error) for frame in frames]


def true_error(measured):
    phase = 2 * np.pi * CYCLIC.harmonic * measured / RANGE + CYCLIC.phase
    return TRUE.constant + CYCLIC.amplitude * np.sin(phase) + PATTERN


DISTANCES = (1.0, 1.4, 1.8, 2.2, 2.6, 3.0)


@pytest.fixture(scope="module")
def walls():
    return [wall(d, yaw=5.0 * (-1) ** k, seed=k) for k, d in enumerate(DISTANCES)]


@pytest.fixture(scope="module")
def fit(walls):
    return calibrate_distance(walls, CAMERA, DISTANCES)


def test_known_distances_give_every_error_back(fit):
    (term,) = fit.corrections.cyclic
    assert fit.corrections.constant == pytest.approx(0.12, abs=0.001)
    assert term.amplitude == pytest.approx(0.03, abs=0.001)
    assert term.phase == pytest.approx(1.1, abs=0.05)
    found = np.array(fit.corrections.per_pixel)
    assert np.std(found - PATTERN) < 0.003
    assert fit.before == pytest.approx(0.03, abs=0.003)
    assert fit.is_checked
    # What remains is noise, of the frames held out and of the pattern.
    assert 0.95 * fit.noise < fit.after < 1.3 * fit.noise
    assert max(fit.walls) < 0.01
    assert fit.warnings == ()
    assert fit.distances == pytest.approx(DISTANCES, abs=1e-4)


def test_corrected_frames_are_flat_and_at_the_right_distance(fit):
    calibration = fit.apply(CAMERA)
    fresh = wall(2.0, seed=99, count=1)[0]
    corrected = calibration.correct(fresh.distance, RANGE)
    middle = corrected[62:82, 78:98]
    assert float(np.median(middle)) == pytest.approx(2.0, abs=0.004)


def test_flatness_alone_gives_the_constant_roughly():
    slanted = [wall(d, yaw=40.0 * (-1) ** k, seed=k) for k, d in enumerate((1.2, 1.6, 2.0))]
    fit = calibrate_distance(slanted, CAMERA)
    assert not fit.is_known
    assert fit.corrections.constant == pytest.approx(0.12, abs=0.02)
    assert "flatness alone" in str(fit)


def test_harmonic_that_the_walls_do_not_span_is_left_out(walls):
    fit = calibrate_distance(walls[:1], CAMERA, DISTANCES[:1])
    assert fit.corrections.cyclic == ()
    assert "the walls span" in fit.left_out[0]


def test_harmonic_that_is_not_there_is_left_out():
    plain = [
        wall(d, seed=k, count=2, error=lambda measured: 0.05 + 0.0 * measured)
        for k, d in enumerate((1.0, 2.0, 3.0))
    ]
    fit = calibrate_distance(plain, CAMERA, (1.0, 2.0, 3.0), per_pixel=False)
    assert fit.corrections.constant == pytest.approx(0.05, abs=0.001)
    assert sum(term.amplitude for term in fit.corrections.cyclic) < 0.001
    assert fit.corrections.per_pixel == ()


def test_no_wall_in_view_is_refused():
    studio = Studio([plate((0, 0, 1.0), 0.2, 0.2, 0.7), plate((-4.9, 0, 2.0), 10, 20, 0.5)], CAMERA)
    rough = with_error(studio.frame(), lambda m: 0.2 * np.sin(50.0 * np.arange(m.size).reshape(m.shape)))
    few = replace(rough, counts=np.where(PATTERN > 0.02, rough.counts, 0).astype(np.uint16))
    with pytest.raises(CalibrationError, match="fill the view with it"):
        calibrate_distance([[few]], CAMERA)


@pytest.fixture(scope="module")
def wedges():
    studio = Studio(SCENES["wedges"](), CAMERA)
    return [studio.frame() for _ in range(4)]


@pytest.mark.parametrize("at", [None, (3.0,)])
def test_a_scene_is_no_wall(wedges, at):
    with pytest.raises(CalibrationError, match=r"wall 1 is no flat wall: off by .* mm RMS, at most 50 mm"):
        calibrate_distance([wedges], CAMERA, at)


def test_the_scene_among_walls_is_named(walls, wedges):
    with pytest.raises(CalibrationError, match="wall 2 is no flat wall"):
        calibrate_distance([walls[0], wedges, walls[2]], CAMERA)


def test_an_implausible_constant_is_refused(walls):
    with pytest.raises(CalibrationError, match=r"distances are -1\d\d\d mm off those given"):
        calibrate_distance(walls[:2], CAMERA, (2.3, 2.7))


def test_a_large_constant_is_told(walls):
    fit = calibrate_distance(walls[:2], CAMERA, (0.7, 1.1))
    assert fit.corrections.constant == pytest.approx(0.42, abs=0.03)
    assert any("mm is large: check the distances" in warning for warning in fit.warnings)


def test_the_wall_at_another_distance_is_named(walls):
    with pytest.raises(CalibrationError, match=r"wall 4, given as 2 m away, is measured .* the others"):
        calibrate_distance(walls, CAMERA, (*DISTANCES[:3], 2.0, *DISTANCES[4:]))


def test_a_wall_with_something_before_it_is_told(walls):
    def shelved(frame):
        counts = frame.counts.copy()
        counts[40:90, 30:110] -= np.uint16(0.045 / RANGE * 65536)
        return replace(frame, counts=counts)

    fit = calibrate_distance([*walls[:5], [shelved(frame) for frame in walls[5]]], CAMERA, DISTANCES)
    (warning,) = fit.warnings
    assert warning.startswith("wall 6 fits worse than the others")


def test_single_frames_give_no_pattern_and_say_so(walls):
    fit = calibrate_distance([frames[:1] for frames in walls], CAMERA, DISTANCES)
    assert fit.corrections.per_pixel == ()
    assert fit.corrections.constant == pytest.approx(0.12, abs=0.002)
    assert not fit.is_checked
    assert "on frames fitted" in str(fit)
    assert "one frame of a wall does not tell it from noise" in str(fit)


def test_noise_is_no_pattern():
    plain = [wall(1.5, count=4, error=lambda measured: 0.0 * measured)]
    fit = calibrate_distance(plain, CAMERA, (1.5,))
    assert fit.corrections.per_pixel == ()
    assert "none stands out of the noise" in str(fit)
    assert fit.after == pytest.approx(fit.noise, rel=0.03)


def test_a_camera_that_turned_is_refused(walls):
    turned = [replace(frame, pan=0.01 * number) for number, frame in enumerate(walls[0])]
    with pytest.raises(CalibrationError, match=r"turned by 1.72° between the 4 frames; expected a camera"):
        calibrate_distance([turned], CAMERA)


def test_distances_must_match_the_walls(walls):
    with pytest.raises(CalibrationError, match="6 walls and 2 distances"):
        calibrate_distance(walls, CAMERA, (1.0, 2.0))
