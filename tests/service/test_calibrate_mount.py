import cv2
import numpy as np
import pytest
from rendered import Studio

from drivers.calibration import Mount, sr3000_calibration
from drivers.poses import camera_centre, camera_rotation
from drivers.position import Position
from drivers.simulation.board import board_scene
from service.calibration.board import Board, Sighting, find_board
from service.calibration.mount import View, calibrate_mount
from service.errors import CalibrationError

CAMERA = sr3000_calibration()
BOARD = Board(9, 6, 0.05)
MOUNT = Mount(rotation=(0.03, -0.02, 0.05), lever_arm=(0.04, -0.06, 0.10))
POSES = [(-8, 0), (-4, -5), (0, 0), (4, 5), (8, 0), (-3, 6), (3, -6)]


def exact(mount=MOUNT, poses=POSES, signs=(1, 1), noise=0.0):
    """The board's corners as projected, from a stage that reports its angles with the given signs."""
    rng = np.random.default_rng(0)
    views = []
    for pan, tilt in np.radians(poses):
        turn, centre = camera_rotation(pan, tilt, mount), camera_centre(pan, tilt, mount)
        corners = (BOARD.points - [0.2, 0.125, 0]) @ cv2.Rodrigues(np.array([0.3, 0.4, 0.1]))[0].T
        seen = (corners + np.array([0, 0, 1.15]) - centre) @ turn
        pixels = seen[:, :2] / seen[:, 2:] * 200.0 + [87.5, 71.5] + rng.normal(0, noise, (54, 2))
        reported = Position(pan * signs[0], tilt * signs[1])
        views.append(View(reported, Sighting(BOARD.points, pixels, np.zeros((4, 2)))))
    return views


def test_exact_corners_give_the_exact_mount():
    fit = calibrate_mount(exact(), CAMERA)
    assert fit.mount.rotation == pytest.approx(MOUNT.rotation, abs=1e-5)
    assert fit.mount.lever_arm == pytest.approx(MOUNT.lever_arm, abs=1e-4)


@pytest.mark.slow
def test_rendered_views_give_the_mount():
    studio = Studio(board_scene(), CAMERA.model_copy(update={"mount": MOUNT}))
    views = []
    for pan, tilt in np.radians(POSES):
        position = Position(float(pan), float(tilt))
        found = find_board(studio.frame(position).amplitude, BOARD)
        if found is not None:
            views.append(View(position, found))
    assert len(views) >= 5
    fit = calibrate_mount(views, CAMERA)
    assert np.abs(np.subtract(fit.mount.rotation, MOUNT.rotation)).max() < np.radians(0.25)
    assert np.abs(np.subtract(fit.mount.lever_arm, MOUNT.lever_arm)).max() < 0.006
    assert fit.apply(CAMERA).mount == fit.mount


def test_deviations_are_those_of_the_noise():
    fit = calibrate_mount(exact(noise=0.1), CAMERA)
    off = np.abs(np.subtract(fit.mount.lever_arm, MOUNT.lever_arm))
    assert np.all(off < 4 * np.array(fit.deviations[3:]))
    assert max(fit.deviations[3:]) < 0.01


def test_pan_alone_leaves_what_it_cannot_tell_at_zero():
    mount = Mount(rotation=(0.03, 0.0, 0.05), lever_arm=(0.04, 0.0, 0.10))
    fit = calibrate_mount(exact(mount, [(pan, 0) for pan in (-10, -5, 0, 5, 10)]), CAMERA)
    assert fit.mount.rotation == pytest.approx(mount.rotation, abs=1e-5)
    assert fit.mount.lever_arm == pytest.approx(mount.lever_arm, abs=1e-4)
    assert fit.deviations[1] == fit.deviations[4] == 0.0
    assert "one axis did not turn" in str(fit)


@pytest.mark.parametrize(("signs", "named"), [((-1, 1), "pan_sign"), ((1, -1), "tilt_sign")])
def test_stage_that_turns_the_wrong_way_is_named(signs, named):
    with pytest.raises(CalibrationError, match=f"reverse {named} in stage.options"):
        calibrate_mount(exact(signs=signs), CAMERA)


@pytest.mark.parametrize("poses", [POSES, [(pan, 0) for pan in (-10, -5, 0, 5, 10)]])
def test_camera_that_hangs_upside_down_is_told(poses):
    mount = Mount(rotation=(0.0, 0.0, np.pi), lever_arm=(0.04, 0.0, 0.10))
    fit = calibrate_mount(exact(mount, poses), CAMERA)
    assert np.abs(fit.mount.rotation) == pytest.approx((0.0, 0.0, np.pi), abs=1e-4)
    assert fit.mount.lever_arm == pytest.approx((0.04, 0.0, 0.10), abs=1e-3)
    assert "upside down" in str(fit)


def test_too_little_is_refused():
    with pytest.raises(CalibrationError, match="4 poses show the board whole"):
        calibrate_mount(exact(poses=POSES[:4]), CAMERA)
    with pytest.raises(CalibrationError, match="the stage turned by 4"):
        calibrate_mount(exact(poses=[(k, 0) for k in range(5)]), CAMERA)


def test_a_board_that_moved_is_refused():
    views = exact()
    shifted = Sighting(BOARD.points, views[3].sighting.pixels + 15.0, np.zeros((4, 2)))
    views[3] = View(views[3].position, shifted)
    with pytest.raises(CalibrationError, match="check the intrinsics, that the board did not move"):
        calibrate_mount(views, CAMERA)
