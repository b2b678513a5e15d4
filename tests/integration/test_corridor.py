"""Real frames, from the vendor's files to a fused map: a corridor with a wall, a box and a floor."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.recording import Recording, open_recording
from service.cli import app
from service.config.sections import FusionSection
from service.jobs.fuse import fuse_recording
from service.messages.map import FusedMap
from solver.geometry.points import points_from_distance

STATION = Path(__file__).parents[3] / "shared" / "data" / "sr4000" / "station1"

WALL, BOX, FLOOR = np.s_[10:60, 4:26], np.s_[15:50, 38:75], np.s_[100:140, 60:120]
"""Flat parts of the view, in sensor pixels."""

Deviation = Callable[[tuple[slice, slice]], tuple[float, float]]

pytestmark = pytest.mark.skipif(not STATION.is_dir(), reason="the real frames are not here")


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("corridor") / "station.mcap"
    frames = [str(frame) for frame in sorted(STATION.iterdir())]
    result = CliRunner().invoke(app, ["import", *frames, "-o", str(path)])
    assert result.exit_code == 0, result.output
    return open_recording(path)


@pytest.fixture(scope="module")
def fused(corridor: Recording) -> FusedMap:
    # The default number of iterations takes longer; this one is enough for what is asked here.
    (result,) = fuse_recording(corridor, FusionSection(method="lidarboost", max_iterations=100))
    return result


@pytest.fixture(scope="module")
def deviation(corridor: Recording, fused: FusedMap) -> Deviation:
    """Standard deviation from the best plane, metres: of one frame, and of the map."""
    calibration, frame = corridor.calibration, fused.frame
    single = calibration.correct(frame.distance, frame.ambiguity_range)
    clouds = (
        (points_from_distance(single, calibration.intrinsics.matrix, calibration.distortion), 1),
        (points_from_distance(fused.distance, fused.intrinsics, calibration.distortion), 4),
    )

    def of(part: tuple[slice, slice]) -> tuple[float, float]:
        one, many = (
            _from_plane(points[tuple(slice(s.start * by, s.stop * by) for s in part)])
            for points, by in clouds
        )
        return one, many

    return of


def _from_plane(points: np.ndarray) -> float:
    cloud = points.reshape(-1, 3)
    cloud = cloud[np.isfinite(cloud).all(axis=1)].astype(np.float64)
    cloud -= cloud.mean(axis=0)
    return float(np.linalg.svd(cloud, full_matrices=False)[1][2] / np.sqrt(len(cloud)))


@pytest.mark.parametrize(
    ("part", "factor"), [(WALL, 0.4), (BOX, 0.3), (FLOOR, 0.6)], ids=["wall", "box", "floor"]
)
def test_flat_parts_have_less_noise_than_one_frame(
    deviation: Deviation, part: tuple[slice, slice], factor: float
) -> None:
    one, many = deviation(part)
    # Averaging four still frames alone would give a half.
    assert many < factor * one


def test_the_wall_of_one_frame_is_as_noisy_as_the_noise_law_says(deviation: Deviation) -> None:
    one, many = deviation(WALL)
    assert 0.005 < one < 0.02
    assert many < 0.005


def test_the_scene_is_where_it_is(fused: FusedMap) -> None:
    """The box stands at the far end, the floor comes towards the camera, nothing lies beyond the range."""
    box, floor = (
        fused.depth[4 * p[0].start : 4 * p[0].stop, 4 * p[1].start : 4 * p[1].stop] for p in (BOX, FLOOR)
    )
    assert 4.3 < np.median(box) < 4.9
    assert np.all(np.diff(np.median(floor, axis=1)[::16]) < 0)
    assert np.nanmax(fused.distance) < 5.0
    assert fused.report.known > 0.95
