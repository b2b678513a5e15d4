"""What pixels average: footprints at exact poses, edges, flying pixels, lever arms, and the truth."""

import numpy as np
import pytest

from drivers import sr3000_calibration
from drivers.calibration import Footprint, Mount
from drivers.poses import camera_rotation
from drivers.position import Position
from drivers.simulation import build_scene
from drivers.simulation.cast import cast
from drivers.simulation.footprint import average, fits, summed_area
from drivers.simulation.render import RAYS, Renderer

RANGE = 7.5
CALIBRATION = sr3000_calibration()


@pytest.fixture(scope="module")
def wedges():
    return Renderer(build_scene("wedges"), CALIBRATION)


@pytest.fixture(scope="module")
def step():
    return Renderer(build_scene("step"), CALIBRATION)


def phasor(renderer, position):
    real, imaginary, _, _ = renderer.correlations([position] * 4, RANGE)
    return real + 1j * imaginary


def test_a_shifted_footprint_is_integrated_exactly():
    rng = np.random.default_rng(1)
    strength, distance = rng.uniform(0.1, 1, (80, 90)), rng.uniform(1, 3, (80, 90))
    tables = summed_area(distance, strength, 2 * np.pi / RANGE)
    dx, dy = 7.3712, 9.8134
    view = np.array([[12.0, 0, dx + 6], [0, 12.0, dy + 6], [0, 0, 1]])
    out = np.empty((4, 5))
    average(tables[0], view, 1.0, out)
    field = strength * np.cos(2 * np.pi / RANGE * distance)

    def shares(start, count):
        """How much of each cell lies between start and start + 12."""
        cells = np.arange(count)
        return np.clip(np.minimum(cells + 1, start + 12) - np.maximum(cells, start), 0, None)

    expected = [
        [shares(dy + 12 * i, 80) @ field @ shares(dx + 12 * j, 90) / 144 for j in range(5)] for i in range(4)
    ]
    np.testing.assert_allclose(out, expected, rtol=1e-10)


def test_a_footprint_leaning_as_after_a_turn_of_15_pixels_is_off_by_less_than_a_tenth_of_a_percent():
    cells = 200
    edge = np.where(np.arange(cells)[:, None] < 100, 1.0, 0.0) * np.ones((1, cells))
    tables = summed_area(np.zeros_like(edge), edge, 1.0)
    for lean in (-0.03, 0.03):
        for offset in np.linspace(-0.6, 0.6, 25):
            view = np.array([[12.0, 0, 100], [12.0 * lean, 12.0, 100 + 12 * offset], [0, 0, 1]])
            out = np.empty((1, 1))
            average(tables[0], view, 1.0, out)
            # The share of the leaning square above the edge: its height there, over columns.
            middle = offset + lean * np.linspace(-0.5, 0.5, 20001)
            exact = np.mean(np.clip(0.5 - middle, 0, 1))
            assert abs(out[0, 0] - exact) < 1e-3


def test_a_view_outside_the_field_does_not_fit():
    table = np.zeros((200, 300))
    assert fits(table, np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 1]]), (198, 298))
    assert not fits(table, np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 1]]), (199, 298))
    assert not fits(table, np.array([[1.0, 0, 0.4], [0, 1, 1], [0, 0, 1]]), (198, 298))
    assert not fits(table, np.array([[-1.0, 0, 0], [0, -1, 0], [0, 0, -1]]), (10, 10))


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, 0.0), (0.0321, -0.0178), (-0.074, 0.071)])
def test_the_finely_rendered_field_agrees_with_rays_cast_through_each_pixel(wedges, pan, tilt):
    """Nine times as many rays, from the turned camera itself. Half a ray of an edge is 4 % of a pixel."""
    rays, rows, columns = 3 * RAYS, slice(50, 86), slice(100, 140)
    k = CALIBRATION.intrinsics
    first = 0.5 / rays - 0.5
    start = ((columns.start + first - k.cx) / k.fx, (rows.start + first - k.cy) / k.fy)
    shape = (36 * rays, 40 * rays)
    turn = camera_rotation(pan, tilt, CALIBRATION.mount)
    packed = build_scene("wedges").packed()
    distance, strength = cast(packed, np.zeros(3), turn, start, (1 / (k.fx * rays), 1 / (k.fy * rays)), shape)
    waves = strength * np.exp(2j * np.pi * distance / RANGE)
    brute = waves.reshape(36, rays, 40, rays).mean(axis=(1, 3))
    error = np.abs(phasor(wedges, Position(pan, tilt))[rows, columns] - brute) / np.abs(brute).mean()
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert error.max() < 0.06
    assert np.median(error) < 0.002


def test_an_edge_moves_with_the_pose_by_thousandths_of_a_pixel(step):
    """The share of the near wall in the edge's pixel is where the edge is, whatever the ray grid."""
    row = 71
    near, far = (phasor(step, Position(0.0, 0.0))[row, column] for column in (86, 89))
    for dx in np.concatenate([np.arange(0.05, 1.0, 0.0501), 7 + np.arange(0.05, 1.0, 0.0907)]):
        # Turned left the world moves right: the edge, at 87.5 at rest, moves by +f · tan(pan).
        edge = 87.5 + dx
        column = int(np.floor(edge + 0.5))
        seen = phasor(step, Position(np.arctan(dx / 200.0), 0.0))[row, column]
        share = np.real((seen - far) / (near - far))
        assert column - 0.5 + share == pytest.approx(edge, abs=0.004)


def test_a_pixel_on_an_edge_flies_between_the_walls(step):
    mixed = phasor(step, Position(np.arctan(0.5 / 200.0), 0.0))[71, 88]
    near, far = 0.6 / 2.0**2, 0.6 / 2.5**2
    expected = 0.5 * (near * np.exp(2j * np.pi * 2.0 / RANGE) + far * np.exp(2j * np.pi * 2.5 / RANGE))
    distance = np.angle(mixed) / (2 * np.pi) * RANGE
    assert distance == pytest.approx(np.angle(expected) / (2 * np.pi) * RANGE, abs=0.002)
    assert abs(mixed) == pytest.approx(abs(expected), rel=0.005)
    # The nearer wall is the brighter one and wins.
    assert 2.15 < distance < 2.22


def test_a_smaller_fill_factor_sharpens_the_edge():
    sharp = Renderer(
        build_scene("step"), CALIBRATION.model_copy(update={"footprint": Footprint(fill_factor=0.5)})
    )
    seen = phasor(sharp, Position(np.arctan(0.8 / 200.0), 0.0))
    # The edge is at 88.3, outside the middle half of pixel 88: that sees the near wall only.
    assert np.angle(seen[71, 88]) / (2 * np.pi) * RANGE == pytest.approx(2.0, abs=1e-4)


def test_a_turn_far_out_of_the_field_is_rendered_about_it(step):
    far_out = phasor(step, Position(0.6, 0.1))
    direct = camera_rotation(0.6, 0.1, CALIBRATION.mount)
    k = CALIBRATION.intrinsics
    for row, column in ((20, 30), (71, 87), (120, 150)):
        ray = direct @ np.array([(column - k.cx) / k.fx, (row - k.cy) / k.fy, 1.0])
        ray /= np.linalg.norm(ray)
        assert ray[0] < 0  # to the left: the near wall
        assert np.angle(far_out[row, column]) / (2 * np.pi) * RANGE % RANGE == pytest.approx(
            2.0 / ray[2], abs=0.002
        )


def test_a_lever_arm_moves_the_centre_and_changes_distances():
    arm = (0.10, 0.02, 0.15)
    levered = Renderer(build_scene("plane"), CALIBRATION.model_copy(update={"mount": Mount(lever_arm=arm)}))
    position = Position(0.05, -0.03)
    seen = phasor(levered, position)
    turn = camera_rotation(position.pan, position.tilt, Mount())
    centre = turn @ np.array(arm)
    k = CALIBRATION.intrinsics
    for row, column in ((10, 10), (72, 88), (130, 160)):
        ray = turn @ np.array([(column - k.cx) / k.fx, (row - k.cy) / k.fy, 1.0])
        expected = (
            (2.0 - centre[2]) / ray[2] * np.linalg.norm([(column - k.cx) / k.fx, (row - k.cy) / k.fy, 1.0])
        )
        assert np.angle(seen[row, column]) / (2 * np.pi) * RANGE == pytest.approx(expected, abs=2e-4)


@pytest.mark.slow
def test_lever_arm_and_field_agree_where_the_arm_is_nothing(wedges):
    """The two ways to render, each pixel by its own rays and all from one field."""
    tiny = CALIBRATION.model_copy(update={"mount": Mount(lever_arm=(1e-12, 0.0, 0.0))})
    direct = phasor(Renderer(build_scene("wedges"), tiny), Position(0.011, 0.007))
    error = np.abs(direct - phasor(wedges, Position(0.011, 0.007))) / np.abs(direct).mean()
    assert np.sqrt(np.mean(error**2)) < 0.015
    assert np.median(error) < 0.002


def test_the_truth_of_a_step_has_two_walls_and_nothing_between(step):
    truth = step.truth(Position(0.0, 0.0), 4, 20_000.0)
    assert truth.distance.shape == truth.depth.shape == truth.amplitude.shape == (576, 704)
    assert truth.distance.dtype == np.float32
    # The edge at column 87.5 is the border between fused columns 351 and 352.
    np.testing.assert_allclose(truth.depth[:, :352], 2.0, atol=1e-5)
    np.testing.assert_allclose(truth.depth[:, 352:], 2.5, atol=1e-5)
    x = ((np.arange(704) + 0.5) / 4 - 0.5 - 87.5) / 200
    y = ((np.arange(576) + 0.5) / 4 - 0.5 - 71.5) / 200
    length = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    np.testing.assert_allclose(truth.distance, truth.depth * length, rtol=1e-6)
    np.testing.assert_allclose(truth.amplitude, 20_000 * 0.6 / length / truth.distance**2, rtol=1e-5)


def test_the_truth_follows_the_reference_pose(step):
    # Turned left by 3 pixels the edge appears 3 pixels, 12 cells, further to the right.
    truth = step.truth(Position(np.arctan(3 / 200.0), 0.0), 4, 1.0)
    row = truth.distance[287]
    assert np.flatnonzero(np.diff(row) > 0.3).tolist() == [363]


def test_the_truth_is_the_distance_of_a_ray_never_an_average(wedges):
    truth = wedges.truth(Position(0.0, 0.0), 4, 1.0)
    k, side = CALIBRATION.intrinsics, 4 * 3
    first = 0.5 / side - 0.5
    distance, _ = cast(
        build_scene("wedges").packed(), np.zeros(3), np.eye(3),
        ((first - k.cx) / k.fx, (first - k.cy) / k.fy), (1 / (200 * side),) * 2, (144 * side, 176 * side),
    )  # fmt: skip
    cells = distance.reshape(576, 3, 704, 3).swapaxes(1, 2).reshape(576, 704, 9)
    np.testing.assert_array_equal(truth.distance, np.median(cells, axis=2).astype(np.float32))


@pytest.mark.parametrize("upsampling", [1, 2, 3, 5])
def test_the_truth_can_be_had_at_any_upsampling(step, upsampling):
    truth = step.truth(Position(0.0, 0.0), upsampling, 1.0)
    assert truth.depth.shape == (144 * upsampling, 176 * upsampling)
    assert set(np.unique(truth.depth.round(4)).tolist()) == {2.0, 2.5}
