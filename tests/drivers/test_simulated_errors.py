"""A simulated camera with the optics, errors, noise and mount of a calibration file."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from drivers.calibration import Calibration, Corrections, CyclicTerm, Mount, NoiseLaw, sr3000_calibration
from drivers.clock import VirtualClock
from drivers.errors import InitialisationError
from drivers.simulated import SimulatedCamera
from drivers.simulation.board import BoardPose, Chessboard, board_views, shown
from drivers.simulation.options import CameraOptions
from drivers.simulation.render import Renderer
from drivers.simulation.scene import Scene, plate
from drivers.simulation.sensor import with_errors
from drivers.stage import Position

LENS = (-0.22, 0.10, 0.001, -0.0015)
AHEAD = Position(0.0, 0.0)


def bent(**changes: object) -> Calibration:
    return sr3000_calibration().model_copy(update={"distortion": LENS, **changes})


def spots(calibration: Calibration, position: Position = AHEAD) -> tuple[np.ndarray, np.ndarray]:
    """(M, 2) centroids, column and row, of small bright plates at 2 m, and where the lens model puts them."""
    places = np.array([(x, y, 2.0) for x in (-0.7, 0.0, 0.7) for y in (-0.55, 0.0, 0.55)])
    renderer = Renderer(Scene("spots", [plate(p, 0.02, 0.02, 0.8) for p in places]), calibration)
    received = renderer.correlations([position] * 4, 7.5)
    light = np.hypot(received[0], received[1])
    expected = cv2.projectPoints(
        places - calibration.mount.lever_arm,
        np.zeros(3),
        np.zeros(3),
        calibration.intrinsics.matrix,
        np.array(calibration.distortion),
    )[0].reshape(-1, 2)
    found = []
    for column, row in expected:
        top, left = int(row) - 3, int(column) - 3
        window = light[top : top + 8, left : left + 8]
        y, x = np.mgrid[top : top + 8, left : left + 8]
        found.append(((window * x).sum() / window.sum(), (window * y).sum() / window.sum()))
    return np.array(found), expected


@pytest.mark.parametrize("arm", [(0.0, 0.0, 0.0), (0.03, -0.05, 0.02)])
def test_a_distorting_lens_shows_points_where_its_model_says(arm: tuple[float, float, float]) -> None:
    found, expected = spots(bent(mount=Mount(lever_arm=arm)))
    straight, _ = spots(sr3000_calibration())
    # The plates' borders are known to a ray, a twelfth of a pixel.
    np.testing.assert_allclose(found, expected, atol=0.07)
    assert np.abs((found - expected).mean(axis=0)).max() < 0.03
    if not any(arm):
        assert np.abs(found - straight).max() > 2  # pixels


def test_a_weak_lens_is_nearly_none() -> None:
    scene = Scene("wall", [plate((0, 0, 2.0), 20, 20, 0.6), plate((0.1, 0.1, 1.5), 0.4, 0.3, 0.6)])
    weak = Renderer(scene, sr3000_calibration().model_copy(update={"distortion": (1e-7, 0.0, 0.0, 0.0)}))
    none = Renderer(scene, sr3000_calibration())
    position = Position(0.01, -0.02)
    seen = [renderer.correlations([position] * 4, 7.5) for renderer in (weak, none)]
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-4)


def test_the_truth_is_seen_through_the_lens() -> None:
    lens = bent()
    truth = Renderer(Scene("wall", [plate((0, 0, 2.0), 20, 20, 0.6)]), lens).truth(AHEAD, 4, 1.0)
    np.testing.assert_allclose(truth.depth, 2.0, atol=0.003)
    corner = np.array([[[-0.375, -0.375]]])  # the centre of the first fused pixel
    x, y = cv2.undistortPoints(corner, lens.intrinsics.matrix, np.array(LENS)).ravel()
    assert truth.distance[0, 0] == pytest.approx(2 * np.sqrt(1 + x * x + y * y), abs=0.003)


def test_errors_are_those_that_the_corrections_take_out() -> None:
    calibration = bent(
        corrections=Corrections(
            constant=0.12,
            cyclic=(CyclicTerm(amplitude=0.05, harmonic=4, phase=0.7),),
            per_pixel=tuple(tuple(0.001 * (i % 7) for i in range(176)) for _ in range(144)),
        )
    )
    counts = np.random.default_rng(0).integers(1, 65536, (144, 176)).astype(np.uint16)
    counts[3, 4] = 0
    measured = with_errors(counts, calibration.corrections, 7.5)
    back = calibration.correct((measured * (7.5 / 65536)).astype(np.float32), 7.5)
    off = (back - counts * (7.5 / 65536) + 3.75) % 7.5 - 3.75
    assert measured[3, 4] == 0
    off[3, 4] = 0
    assert np.abs(off).max() < 2e-4  # a count is 0.11 mm
    assert np.abs(measured.astype(int) - counts)[measured > counts].max() > 1000


def camera(**options: object) -> SimulatedCamera:
    return SimulatedCamera(CameraOptions.model_validate(options), VirtualClock(10**18))


def test_a_camera_does_as_its_file_says(tmp_path: Path) -> None:
    true = bent(
        corrections=Corrections(constant=0.2),
        noise=NoiseLaw(coefficient=60.0),
        distortion=(),
        source="mine",
    )
    true.save(tmp_path / "true.toml")
    made = camera(scene="plane", away=1.5, calibration=tmp_path / "true.toml", calibrated=False)
    with made:
        made.start()
        frame = made.grab()
        assert made.calibration == sr3000_calibration()
        assert made.true_calibration == true
    middle = frame.distance[62:82, 78:98]
    assert float(np.median(middle)) == pytest.approx(1.7, abs=0.01)
    sigma = 60.0 / float(np.median(frame.amplitude[62:82, 78:98]))
    assert float(middle.std()) == pytest.approx(sigma, rel=0.15)


def test_a_camera_may_know_its_file(tmp_path: Path) -> None:
    true = bent(source="mine")
    true.save(tmp_path / "true.toml")
    made = camera(scene="plane", calibration=tmp_path / "true.toml")
    with made:
        assert made.calibration == true


def test_mount_and_file_are_not_both_taken(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="lever_arm: the calibration file says that"):
        camera(calibration=tmp_path / "true.toml", lever_arm=(0.0, 0.0, 0.1))


def test_a_file_of_another_size_is_refused(tmp_path: Path) -> None:
    sr3000_calibration().model_copy(update={"width": 160}).save(tmp_path / "true.toml")
    with pytest.raises(InitialisationError, match="160 × 144 pixels; the simulated one has 176 × 144"):
        camera(calibration=tmp_path / "true.toml")


@pytest.mark.parametrize("board", [Chessboard(), Chessboard(8, 5, 0.04), Chessboard(5, 9, 0.03)])
def test_views_of_a_board_are_whole_tilted_and_everywhere(board: Chessboard) -> None:
    lens = bent()
    views = board_views(board, 18, lens)
    i, j = np.mgrid[: board.columns, : board.rows]
    corners = np.stack([i.ravel(), j.ravel(), np.zeros(i.size)], axis=1).astype(float)
    corners = (corners - [(board.columns - 1) / 2, (board.rows - 1) / 2, 0]) * board.square
    pixels = np.concatenate(
        [
            cv2.projectPoints(
                corners @ view.rotation.T + view.centre,
                np.zeros(3),
                np.zeros(3),
                lens.intrinsics.matrix,
                np.array(LENS),
            )[0].reshape(-1, 2)
            for view in views
        ]
    )
    assert (pixels > 5).all()
    assert (pixels < [170, 138]).all()
    cells = {(int(row // 36), int(column // 35.2)) for column, row in pixels}
    assert len(cells) == 20
    normals = np.array([view.rotation[:, 2] for view in views])
    assert np.degrees(np.arccos((normals @ normals.T).min())) > 40


def test_a_board_is_held_as_the_camera_sees_it() -> None:
    pose = BoardPose(np.eye(3), np.array([0.1, 0.0, 1.0]))
    left = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # the camera looks left
    there = pose.seen_from(left, np.array([0.0, 0.0, 0.5]))
    np.testing.assert_allclose(there.centre, (-1.0, 0.0, 0.6))
    assert len(shown(Chessboard(), there)) == 1 + 35 + 1


def test_what_is_shown_may_change() -> None:
    made = camera(scene="plane", noise=False)
    with made:
        made.start()
        before = made.grab()
        made.show([plate((0, 0, 1.0), 20, 20, 0.6)])
        after = made.grab()
    assert before.distance[72, 88] == pytest.approx(2.0, abs=0.001)
    assert after.distance[72, 88] == pytest.approx(1.0, abs=0.001)
