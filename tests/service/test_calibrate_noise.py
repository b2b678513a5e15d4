from pathlib import Path

import pytest
from rendered import Studio

from drivers.calibration import sr3000_calibration
from drivers.settings import CameraSettings
from drivers.simulation.scene import plate
from drivers.simulation.scenes import SCENES
from drivers.simulation.sensor import NOISE_COEFFICIENT
from service.calibration.noise import calibrate_noise
from service.errors import CalibrationError

CAMERA = sr3000_calibration()
SR4000 = Path(__file__).parents[2] / ".." / "shared" / "data" / "sr4000"


@pytest.fixture(scope="module")
def objects():
    studio = Studio(SCENES["objects"](), CAMERA)
    return [studio.frame() for _ in range(8)]


def test_finds_the_simulated_law(objects):
    fit = calibrate_noise([objects])
    assert fit.law.coefficient == pytest.approx(NOISE_COEFFICIENT, rel=0.03)
    assert fit.slope == pytest.approx(-1.0, abs=0.05)
    assert fit.apply(CAMERA).noise == fit.law
    assert "from 8 frames" in str(fit)


def test_law_does_not_depend_on_the_integration_time():
    studio = Studio(SCENES["objects"](), CAMERA)
    settings = CameraSettings(integration_time=0.010)
    fit = calibrate_noise([[studio.frame(settings=settings) for _ in range(4)]])
    assert fit.law.coefficient == pytest.approx(NOISE_COEFFICIENT, rel=0.05)


def test_too_little_is_refused(objects):
    with pytest.raises(CalibrationError, match="at least two of each scene"):
        calibrate_noise([objects[:1]])
    wall = Studio([plate((0, 0, 2.0), 20, 20, 0.6)], CAMERA)
    frame = wall.frame()
    with pytest.raises(CalibrationError, match="bright and dark things"):
        calibrate_noise([[frame, frame]])


def test_frames_of_different_settings_are_refused(objects):
    studio = Studio(SCENES["objects"](), CAMERA)
    other = studio.frame(settings=CameraSettings(integration_time=0.010))
    with pytest.raises(CalibrationError, match="2 different settings"):
        calibrate_noise([[*objects, other]])


@pytest.mark.skipif(not SR4000.exists(), reason="real frames are not at hand")
def test_real_frames_follow_the_known_law():
    from drivers.importers.exposure import ImportOptions
    from drivers.importers.importing import import_frames

    scenes = [
        list(import_frames(sorted((SR4000 / station).glob("*.dat")), ImportOptions()).frames())
        for station in ("station1", "station2")
    ]
    fit = calibrate_noise(scenes)
    # Measured before on the same frames: σ = 3.8 z² / A with A in gray mode.
    assert fit.law.coefficient == pytest.approx(3.8, rel=0.15)
    assert -0.95 < fit.slope < -0.7  # between the law and pure shot noise
