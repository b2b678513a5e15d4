import cv2
import numpy as np
import pytest
from rendered import Studio
from scipy.spatial.transform import Rotation

from drivers.calibration import Intrinsics, sr3000_calibration
from drivers.simulation.board import Chessboard
from drivers.simulation.scene import plate
from service.calibration.board import Board, find_board
from service.calibration.intrinsics import calibrate_intrinsics, coverage, distinct_views
from service.errors import CalibrationError

BOARD = Board(9, 6, 0.05)
SHAPE = sr3000_calibration().shape
OPTICS = Intrinsics(fx=206.0, fy=204.0, cx=85.0, cy=74.0)
CAMERA = sr3000_calibration().model_copy(update={"intrinsics": OPTICS})


def sighting(turn, place, camera=CAMERA):
    """The board, turned by Euler angles yxz (degrees), as the simulated camera sees it."""
    rotation = Rotation.from_euler("yxz", turn, degrees=True).as_matrix()
    surfaces = [*Chessboard().surfaces(rotation, place), plate((0, 0, 3.0), 20, 20, 0.4)]
    return find_board(Studio(surfaces, camera).frame().amplitude, BOARD)


POSES = [
    ((0, 0, 0), (0.0, 0.0, 0.85)),
    ((30, 0, 0), (0.02, 0.05, 0.80)),
    ((-30, 0, 5), (0.0, -0.05, 0.85)),
    ((0, 30, 0), (-0.10, 0.02, 0.85)),
    ((0, -30, -5), (0.10, 0.0, 0.85)),
    ((20, 20, 10), (-0.15, -0.10, 1.00)),
    ((-20, 20, -10), (0.15, -0.12, 1.00)),
    ((20, -20, 0), (-0.16, 0.13, 1.00)),
    ((-20, -20, 0), (0.18, 0.13, 1.00)),
    ((10, 25, 90), (0.05, -0.02, 1.00)),
]


@pytest.fixture(scope="module")
def sightings():
    return [sighting(*pose) for pose in POSES]


def test_finds_corners_to_a_tenth_of_a_pixel(sightings):
    found = sightings[0]
    expected = BOARD.points[:, :2] - BOARD.points[:, :2].mean(axis=0)
    pixels = expected / 0.85 * [OPTICS.fx, OPTICS.fy] + [OPTICS.cx, OPTICS.cy]
    error = min(np.sqrt(np.mean((found.pixels - way) ** 2)) for way in (pixels, pixels[::-1]))
    assert error < 0.12


def test_finds_the_simulated_optics(sightings):
    seen = [found for found in sightings if found is not None]
    assert len(seen) >= 9
    fit = calibrate_intrinsics(seen, SHAPE)
    k = fit.intrinsics
    assert (k.fx, k.fy) == pytest.approx((206.0, 204.0), rel=0.01)
    assert (k.cx, k.cy) == pytest.approx((85.0, 74.0), abs=1.0)
    assert fit.error < 0.2
    assert fit.apply(CAMERA).intrinsics == k


def test_finds_distortion_in_exact_corners():
    lens = np.array([-0.25, 0.1, 0.002, -0.001])
    views = []
    for turn, place in POSES:
        rotation = Rotation.from_euler("yxz", turn, degrees=True).as_rotvec()
        points = BOARD.points - [0.2, 0.125, 0]
        pixels, _ = cv2.projectPoints(points, rotation, np.array(place), OPTICS.matrix, lens)
        views.append(made(pixels.reshape(-1, 2)))
    fit = calibrate_intrinsics(views, SHAPE)
    assert fit.distortion == pytest.approx(tuple(lens), abs=1e-4)
    assert fit.error < 1e-3


def made(pixels):
    from service.calibration.board import Sighting

    corners = pixels.reshape(6, 9, 2)[[0, 0, -1, -1], [0, -1, -1, 0]]
    return Sighting(BOARD.points, pixels, corners)


def exact(turns, places):
    views = []
    for turn, place in zip(turns, places, strict=True):
        rotation = Rotation.from_euler("yxz", turn, degrees=True).as_rotvec()
        points = BOARD.points - [0.2, 0.125, 0]
        pixels, _ = cv2.projectPoints(points, rotation, np.array(place), OPTICS.matrix, None)
        views.append(made(pixels.reshape(-1, 2)))
    return views


def test_views_alike_count_once():
    views = exact([(0, 0, 0), (0, 0, 0), (30, 0, 0)], [(0, 0, 0.8), (0.002, 0, 0.8), (0, 0, 0.8)])
    assert len(distinct_views(views, SHAPE[1])) == 2


def test_too_few_views_are_refused(sightings):
    with pytest.raises(CalibrationError, match="3 different views of the board, at least 8 are needed"):
        calibrate_intrinsics([*sightings[:3], *sightings[:3]], SHAPE)


def test_a_board_that_stays_in_the_middle_is_refused():
    views = exact([(6 * k, 30 - 6 * k, 0) for k in range(10)], [(0, 0, 2.2 + 0.25 * k) for k in range(10)])
    assert coverage(views, SHAPE) < 0.5
    with pytest.raises(CalibrationError, match=r"corners cover \d+ % of the image|different views"):
        calibrate_intrinsics(views, SHAPE)


def test_a_board_that_always_faces_the_camera_is_refused():
    places = [(x, y, 0.8) for x in (-0.12, 0.0, 0.12) for y in (-0.08, 0.0, 0.08)]
    with pytest.raises(CalibrationError, match="directions differ by 0°"):
        calibrate_intrinsics(exact([(0, 0, 0)] * 9, places), SHAPE)


def test_a_view_that_does_not_fit_is_left_out():
    turns, places = zip(*POSES, strict=True)
    views = exact(turns, places)
    rng = np.random.default_rng(0)
    noisy = [made(view.pixels + rng.normal(0, 0.05, view.pixels.shape)) for view in views]
    noisy[4] = made(views[4].pixels + rng.normal(0, 2.0, views[4].pixels.shape))
    fit = calibrate_intrinsics(noisy, SHAPE)
    assert fit.left_out == 1
    assert fit.intrinsics.fx == pytest.approx(206.0, rel=0.01)


def test_charuco_board_is_found_in_part():
    board = Board(5, 4, 0.06, "DICT_4X4_50", 0.045)
    printed = cv2.aruco.CharucoBoard(
        (6, 5), 0.06, 0.045, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    ).generateImage((720, 600), marginSize=0)
    shown = np.full((5 * 144, 5 * 176), 200, np.uint8)
    shown[60:660, 200:] = printed[:, :680]
    image = cv2.resize(shown, (176, 144), interpolation=cv2.INTER_AREA).astype(np.float64)
    found = find_board(image**2, board)
    assert found is not None
    expected = (found.points[:, :2] / 0.06 + 1) * 24 + [40, 12] - 0.5
    assert found.pixels == pytest.approx(expected, abs=0.3)


def test_unknown_dictionary_is_refused():
    with pytest.raises(CalibrationError, match="no marker dictionary 'DICT_9X9'"):
        find_board(np.ones(SHAPE), Board(5, 4, 0.06, "DICT_9X9", 0.045))


def test_no_board_in_view():
    assert find_board(np.random.default_rng(0).uniform(0, 1000, SHAPE), BOARD) is None
