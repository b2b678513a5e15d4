"""The simulated camera: its laws of light and noise, its time, its counts, and what motion does to it."""

from dataclasses import replace

import numpy as np
import pytest

from drivers import (
    DeviceTimeoutError,
    InitialisationError,
    StateError,
    make_camera,
    make_stage,
)
from drivers.clock import VirtualClock
from drivers.frame import COUNTS_PER_RANGE
from drivers.settings import CameraSettings
from drivers.simulation import build_scene
from drivers.simulation.render import Renderer
from drivers.simulation.sensor import FULL_SCALE, GAIN, expose

START = 1_700_000_000 * 10**9
X, Y = np.meshgrid((np.arange(176) - 87.5) / 200, (np.arange(144) - 71.5) / 200)
LENGTH = np.sqrt(1 + X**2 + Y**2)

pytestmark = pytest.mark.usefixtures("rendered_once")


@pytest.fixture
def camera_of():
    """Makes open, started cameras on one virtual clock, and closes them."""
    made = []

    def make(scene="plane", stage=None, settings=None, **options):
        clock = stage.clock if stage is not None else VirtualClock(START)
        camera = make_camera("simulated", {"scene": scene, **options}, clock)
        made.append(camera)
        if stage is not None:
            camera.mount_on(stage)
        camera.open()
        if settings is not None:
            camera.settings = settings
        camera.start()
        return camera

    yield make
    for camera in made:
        camera.close()


def test_a_wall_at_two_metres_has_three_thousand_counts_by_the_law_of_light(camera_of):
    frame = camera_of(noise=False).grab()
    np.testing.assert_allclose(frame.distance, 2.0 * LENGTH, atol=1e-4)
    # Reflectivity · cos(incidence) / distance²: 3,000 counts ahead, cos³ of the angle elsewhere.
    np.testing.assert_allclose(frame.amplitude, 3000 / LENGTH**3, atol=0.6)
    assert frame.amplitude[71, 87] == pytest.approx(3000, abs=1)
    assert frame.valid.all()
    assert (frame.ambiguity_range, frame.integration_time, frame.amplitude_mode) == (7.5, 0.030, "linear")


def test_amplitude_falls_with_distance_squared_and_grows_with_integration_time(camera_of):
    near = camera_of("step", noise=False)
    frame = near.grab()
    assert frame.amplitude[71, 80] / frame.amplitude[71, 95] == pytest.approx((2.5 / 2.0) ** 2, rel=2e-3)
    near.settings = CameraSettings(integration_time=0.010)
    assert near.grab().amplitude[71, 80] == pytest.approx(frame.amplitude[71, 80] / 3, abs=1)


@pytest.mark.parametrize(("integration_time", "frequency"), [(0.030, 20e6), (0.0075, 20e6), (0.030, 30e6)])
def test_the_noise_follows_the_amplitude_law_that_the_calibration_states(
    camera_of, integration_time, frequency
):
    settings = CameraSettings(integration_time=integration_time, modulation_frequency=frequency)
    camera = camera_of(settings=settings, seed=3)
    frames = [camera.grab() for _ in range(40)]
    distance = np.stack([frame.distance for frame in frames]).astype(np.float64)
    coefficient = camera.calibration.noise.coefficient
    expected = coefficient / (3000 * integration_time / 0.030 / LENGTH**3)
    scaled = (distance - 2.0 * LENGTH) / expected
    assert scaled.std() == pytest.approx(1.0, abs=0.01)
    assert abs(scaled.mean()) < 0.01
    neighbours = np.mean(scaled[:, :, 1:] * scaled[:, :, :-1])
    frames_apart = np.mean(scaled[1:] * scaled[:-1])
    assert abs(neighbours) < 0.01
    assert abs(frames_apart) < 0.01
    if (integration_time, frequency) == (0.030, 20e6):
        assert coefficient == pytest.approx(30.0)
        assert distance[:, 60:84, 76:100].std(axis=0).mean() == pytest.approx(0.010, rel=0.03)
    per_second = camera.calibration.noise.for_signal(integration_time)
    np.testing.assert_allclose(per_second / frames[0].signal.mean(), expected.mean(), rtol=0.05)


def test_frames_repeat_with_the_seed_whatever_was_dropped_before(camera_of):
    first, second, other = camera_of(seed=1), camera_of(seed=1), camera_of(seed=2)
    a = [first.grab() for _ in range(4)]
    second.clock.sleep(3.5 * 0.121)
    b = second.grab()
    assert b.sequence == 2
    np.testing.assert_array_equal(a[2].counts, b.counts)
    np.testing.assert_array_equal(a[2].amplitude, b.amplitude)
    assert np.mean(a[0].counts != a[1].counts) > 0.9
    assert np.mean(a[0].counts != other.grab().counts) > 0.9


def test_distances_wrap_at_the_ambiguity_range(camera_of):
    frame = camera_of(noise=False, settings=CameraSettings(modulation_frequency=80e6)).grab()
    assert frame.ambiguity_range == pytest.approx(1.875)
    np.testing.assert_allclose(frame.distance, 2.0 * LENGTH % 1.875, atol=1e-4)


def test_gray_mode_multiplies_by_distance_squared_and_signal_undoes_it(camera_of):
    linear = camera_of(noise=False).grab()
    gray = camera_of(noise=False, settings=CameraSettings(amplitude_mode="gray")).grab()
    np.testing.assert_allclose(gray.amplitude, linear.amplitude * linear.distance**2, atol=3)
    np.testing.assert_allclose(gray.signal, linear.signal, rtol=2e-3)


def test_pixels_under_the_amplitude_threshold_are_rejected(camera_of):
    frame = camera_of(noise=False, settings=CameraSettings(amplitude_threshold=2500)).grab()
    dark = 3000 / LENGTH**3
    clear = np.abs(dark - 2500) > 1
    np.testing.assert_array_equal((frame.counts == 0)[clear], (dark < 2500)[clear])
    assert np.isnan(frame.distance[0, 0])


def received(amplitude, distance, settings):
    """Four samples of pixels that receive so many counts from so far."""
    wave = np.asarray(amplitude) / (GAIN * settings.integration_time)
    wave = wave * np.exp(2j * np.pi * np.asarray(distance) / settings.ambiguity_range)
    return np.stack([wave.real, wave.imag, wave.real, wave.imag])


def test_too_much_light_saturates(camera_of):
    settings = CameraSettings()
    frame = camera_of(noise=False).grab()
    amplitude = np.array([[1000.0, 60_000.0, 70_000.0, 200_000.0]])
    counts, delivered = expose(received(amplitude, np.full((1, 4), 2.0), settings), settings, None)
    assert delivered.tolist()[0][0] == 1000
    assert delivered.tolist()[0][2:] == [FULL_SCALE, FULL_SCALE]
    bright = replace(frame, counts=counts, amplitude=delivered)
    assert bright.valid.tolist() == [[True, True, False, False]]
    assert np.isnan(bright.distance[0, 2])


def test_a_count_of_zero_means_rejected_and_never_a_distance():
    settings = CameraSettings()
    distance = np.array([[0.0, 7.5, 7.5 - 1e-6, 15.0]])
    counts, _ = expose(received(np.full((1, 4), 3000.0), distance, settings), settings, None)
    assert (counts > 0).all()
    near = np.minimum(counts, COUNTS_PER_RANGE - counts.astype(int))
    assert (near <= 1).all()


def test_an_impossible_rate_is_refused_and_says_what_is_possible(camera_of):
    camera = camera_of()
    before = camera.settings
    with pytest.raises(InitialisationError, match=r"50 frames/s.*30 ms.*121\.00 ms.*at most 8\.26") as caught:
        camera.settings = CameraSettings(frame_rate=50)
    assert "4.75 ms" in str(caught.value)
    assert camera.settings == before
    camera.settings = CameraSettings(integration_time=0.00475, frame_rate=50)
    times = [camera.grab().timestamp for _ in range(5)]
    assert set(np.diff(times)) == {20_000_000}


def test_a_frame_takes_four_integration_times_and_readout(camera_of):
    camera = camera_of(readout=0.005)
    first, second = camera.grab(), camera.grab()
    assert second.timestamp - first.timestamp == 125_000_000
    assert second.sequence == first.sequence + 1
    assert first.timestamp == START + 62_500_000
    assert camera.clock.now() == START + 250_000_000


def test_late_callers_get_the_latest_frame_and_the_gap_shows(camera_of):
    camera = camera_of()
    assert camera.grab().sequence == 0
    camera.clock.sleep(0.121 * 5.5)
    late = camera.grab()
    assert late.sequence == 5
    assert camera.clock.now() - late.timestamp == pytest.approx(0.121e9, abs=1e3)
    assert camera.grab().sequence == 6


def test_no_frame_in_time_is_a_timeout(camera_of):
    camera = camera_of()
    with pytest.raises(DeviceTimeoutError, match=r"0\.121 s"):
        camera.grab(timeout=0.05)
    assert camera.grab(timeout=0.1).sequence == 0


def test_settings_begin_a_new_schedule_but_not_new_numbers(camera_of):
    camera = camera_of()
    camera.grab()
    camera.settings = CameraSettings(integration_time=0.002)
    frame = camera.grab()
    assert (frame.sequence, frame.integration_time) == (1, 0.002)
    assert frame.timestamp - START == 121_000_000 + 4_500_000


def test_the_world_turns_with_the_stage(camera_of):
    stage = make_stage("simulated", {"resolution": 0, "pointing_error": 0}, VirtualClock(START))
    with stage:
        camera = camera_of("step", stage, noise=False)
        still = camera.grab()
        stage.move_to(np.arctan(3 / 200), 0.0)
        stage.wait()
        camera.clock.sleep(0.2)
        turned = camera.grab()
        turned = camera.grab()
    assert np.flatnonzero(np.diff(still.distance[71]) > 0.3).tolist() == [87]
    assert np.flatnonzero(np.diff(turned.distance[71]) > 0.3).tolist() == [90]
    assert turned.pan == pytest.approx(np.arctan(3 / 200))


def test_a_stage_that_moves_gives_the_four_samples_of_a_frame_different_poses(camera_of):
    stage = make_stage("simulated", {"speed": 5}, VirtualClock(START))
    with stage:
        camera = camera_of("step", stage, noise=False)
        stage.move_to(-0.15, 0.0)
        stage.move_to(0.15, 0.0)
        frame = camera.grab()
        # 30 ms and a quarter of the readout each, centred in the exposure.
        times = [frame.timestamp + round((k - 1.5) * 30.25e6) for k in range(4)]
        poses = [stage.pose_at(time) for time in times]
        calibration, settings = camera.calibration, camera.settings
    assert np.degrees(poses[3].pan - poses[0].pan) == pytest.approx(5 * 0.09075, rel=1e-3)
    renderer = Renderer(build_scene("step"), calibration)
    waves = [renderer.correlations([pose] * 4, 7.5) for pose in poses]
    expected = np.stack([waves[0][0], waves[1][1], waves[2][2], waves[3][3]])
    counts, amplitude = expose(expected, settings, None)
    np.testing.assert_array_equal(frame.counts, counts)
    np.testing.assert_array_equal(frame.amplitude, amplitude)
    at_rest, _ = expose(waves[1], settings, None)
    # Around the edge, which passes 1.6 pixels during the frame, and nowhere else.
    differs = np.abs(frame.counts.astype(int) - at_rest.astype(int)) > 100
    assert 1 <= differs[71].sum() <= 4


def test_the_calibration_is_that_of_an_sr3000(camera_of):
    camera = camera_of(lever_arm=(0.0, 0.05, 0.1), fill_factor=0.8)
    found = camera.calibration
    assert (found.width, found.height) == (176, 144)
    assert (found.intrinsics.fx, found.intrinsics.fy) == (200.0, 200.0)
    assert found.mount.lever_arm == (0.0, 0.05, 0.1)
    assert found.footprint.fill_factor == 0.8
    assert camera.capabilities.source == "simulation"
    assert not camera.capabilities.carries_pose


def test_the_truth_is_what_a_frame_without_noise_shows_away_from_edges(camera_of):
    camera = camera_of("sphere", noise=False)
    truth, frame = camera.truth(), camera.grab()
    cells = truth.distance.reshape(144, 4, 176, 4).swapaxes(1, 2).reshape(144, 176, 16)
    smooth = np.ptp(cells, axis=2) < 0.02
    assert smooth.mean() > 0.85
    np.testing.assert_allclose(frame.distance[smooth], cells.mean(axis=2)[smooth], atol=1.5e-3)
    light = truth.amplitude.reshape(144, 4, 176, 4).mean(axis=(1, 3))
    brightness = frame.amplitude[smooth] / light[smooth]
    # A sliver of the ball in a pixel of the wall is not the median of any cell, but it does cost light.
    assert np.quantile(np.abs(brightness - 1), 0.999) < 3e-3
    np.testing.assert_allclose(brightness, 1.0, atol=0.03)


def test_the_truth_needs_an_open_camera():
    with pytest.raises(StateError, match="open it first"):
        make_camera("simulated").truth()


def test_an_unknown_scene_is_refused_with_the_known_ones():
    with pytest.raises(InitialisationError, match=r"scene: .*'moon'.*wedges, objects"):
        make_camera("simulated", {"scene": "moon"})
