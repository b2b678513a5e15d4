"""The ray caster against geometry worked out by hand, and the scenes by name."""

import numpy as np
import pytest

from drivers.errors import InitialisationError
from drivers.simulation import SCENES, build_scene, textures
from drivers.simulation.cast import cast
from drivers.simulation.scene import (
    Holes,
    Scene,
    Surface,
    Texture,
    disc,
    frustum,
    plate,
    sphere,
    triangle,
)

GRID = np.linspace(-0.4, 0.4, 161)


def look(*surfaces, origin=(0.0, 0.0, 0.0), turn=None):
    """Distance and strength of 161 × 161 rays, x and y from −0.4 to 0.4 at z = 1."""
    step = GRID[1] - GRID[0]
    scene = Scene("test", surfaces)
    turn = np.eye(3) if turn is None else turn
    return cast(scene.packed(), np.array(origin), turn, (GRID[0], GRID[0]), (step, step), (161, 161))


X, Y = np.meshgrid(GRID, GRID)
LENGTH = np.sqrt(1 + X**2 + Y**2)


def test_a_wall_ahead_has_the_distance_and_light_of_a_matt_surface():
    distance, strength = look(plate((0, 0, 2.0), 10, 10, 0.6))
    np.testing.assert_allclose(distance, 2.0 * LENGTH, rtol=1e-12)
    np.testing.assert_allclose(strength, 0.6 / LENGTH / (2.0 * LENGTH) ** 2, rtol=1e-12)


def test_a_ball_before_nothing_gives_the_nearer_crossing_and_no_light_beside_it():
    centre, radius = np.array([0.2, -0.1, 2.0]), 0.3
    distance, strength = look(sphere(centre, radius, 0.5))
    rays = np.stack([X, Y, np.ones_like(X)], axis=-1) / LENGTH[..., None]
    along = rays @ centre
    inside = along**2 - centre @ centre + radius**2
    hit = inside > 0
    expected = along[hit] - np.sqrt(inside[hit])
    np.testing.assert_allclose(distance[hit], expected, rtol=1e-12)
    assert np.isinf(distance[~hit]).all()
    assert (strength[~hit] == 0).all()
    normal = (rays[hit] * expected[:, None] - centre) / radius
    cosine = np.abs(np.sum(normal * rays[hit], axis=1))
    np.testing.assert_allclose(strength[hit], 0.5 * cosine / expected**2, rtol=1e-9)


def test_the_side_of_a_cone_lies_where_its_equation_says():
    lower, upper, height = 0.3, 0.2, 0.6
    distance, _ = look(frustum((0, 0, 2.0), (lower, upper), height, 0.6))
    hit = np.isfinite(distance)
    points = np.stack([X, Y, np.ones_like(X)], axis=-1)[hit] / LENGTH[hit][:, None] * distance[hit][:, None]
    up = -points[:, 1]
    around = np.hypot(points[:, 0], points[:, 2] - 2.0)
    np.testing.assert_allclose(around, lower + (upper - lower) * (up / height + 0.5), atol=1e-9)
    assert (np.abs(up) <= height / 2 + 1e-9).all()
    assert hit[80, 80]
    assert distance[80, 80] == pytest.approx(2.0 - 0.25)


@pytest.mark.parametrize("round_holes", [True, False])
def test_holes_let_through_what_lies_behind(round_holes):
    holes = Holes((0.2, 0.2), (0.05, 0.05), (0.25, 0.15), round=round_holes)
    front = plate((0, 0, 1.0), 0.7, 0.7, 0.6, holes=holes)
    distance, _ = look(front, plate((0, 0, 3.0), 10, 10, 0.6))
    depth = distance / LENGTH
    column, row = np.round(X / 0.2) * 0.2, np.round(-Y / 0.2) * 0.2
    du, dv = np.abs(X - column) / 0.05, np.abs(-Y - row) / 0.05
    within = du**2 + dv**2 < 1 if round_holes else (du < 1) & (dv < 1)
    hole = within & (np.abs(column) <= 0.25) & (np.abs(row) <= 0.15)
    outside = (np.abs(X) > 0.35) | (np.abs(Y) > 0.35)
    border = (np.abs(np.abs(X) - 0.35) < 1e-9) | (np.abs(np.abs(Y) - 0.35) < 1e-9)
    edge = border | (
        (np.abs(np.maximum(du, dv) - 1) < 1e-9) if not round_holes else (np.abs(du**2 + dv**2 - 1) < 1e-9)
    )
    np.testing.assert_allclose(depth[~edge], np.where(hole | outside, 3.0, 1.0)[~edge], rtol=1e-9)
    assert hole.sum() > 500


def test_a_triangle_has_its_three_corners():
    left, right, tip = (-0.3, 0.2, 1.0), (0.1, 0.3, 1.0), (0.25, -0.3, 1.0)
    distance, _ = look(triangle(left, right, tip, 0.6))
    a, b, c = (np.array(p[:2]) for p in (left, right, tip))

    def side(p, q):
        return (q[0] - p[0]) * (Y - p[1]) - (q[1] - p[1]) * (X - p[0])

    signs = np.stack([side(a, b), side(b, c), side(c, a)])
    clear = (np.abs(signs) > 1e-9).all(axis=0)
    inside = (signs > 0).all(axis=0) | (signs < 0).all(axis=0)
    assert (np.isfinite(distance) == inside)[clear].all()
    np.testing.assert_allclose((distance / LENGTH)[inside & clear], 1.0, rtol=1e-9)


def test_a_disc_turned_about_the_vertical_is_nearer_on_one_side():
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    distance, _ = look(disc((0, 0, 2.0), 0.4, 0.6).turned(turn, (0, 0, 2.0)))
    depth = distance / LENGTH
    assert depth[80, 80] == pytest.approx(2.0)
    hit = np.isfinite(depth)
    # The plane through (0, 0, 2) with normal turn · (0, 0, −1): x sin + (z − 2) cos = 0.
    z = depth[hit]
    np.testing.assert_allclose(X[hit] * z * s + (z - 2.0) * c, 0.0, atol=1e-12)


def test_a_texture_multiplies_the_reflectivity_where_it_should():
    picture = Texture(textures.checks(2, 0.25), (0.8, 0.8))
    _, strength = look(plate((0, 0, 1.0), 0.8, 0.8, 0.6, texture=picture))
    reflectivity = strength * LENGTH**3
    assert reflectivity[40, 40] == pytest.approx(0.6, rel=1e-6)
    assert reflectivity[40, 120] == pytest.approx(0.15, rel=1e-6)
    assert reflectivity[120, 40] == pytest.approx(0.15, rel=1e-6)


def test_moving_and_turning_the_grid_moves_the_view():
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    distance, _ = look(plate((0, 0, 2.0), 20, 20, 0.6), origin=(0.1, 0.0, 0.25), turn=turn)
    forward = (-s * X + c) / LENGTH
    np.testing.assert_allclose(distance, 1.75 / forward, rtol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_is_the_same_each_time(name):
    first, second = (look(*build_scene(name).surfaces) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("name", ["wedges", "objects", "plane", "step", "sphere"])
def test_scenes_to_be_fused_fill_the_view_at_two_to_four_metres(name):
    first = look(*build_scene(name).surfaces)
    assert np.isfinite(first[0]).all()
    assert 1.5 < first[0].min() < first[0].max() < 4.5


def test_the_print_of_the_box_returns_hardly_any_light():
    distance, strength = look(*build_scene("objects").surfaces)
    box = (distance / LENGTH < 2.7) & (X > 0.2) & (Y > -0.1) & (Y < 0.05)
    reflectivity = (strength * distance**2)[box]
    assert np.mean(reflectivity < 0.02) > 0.15
    assert np.mean(reflectivity > 0.4) > 0.15


def test_an_unknown_scene_says_which_there_are():
    with pytest.raises(InitialisationError, match=r"'moon'.*wedges, objects"):
        build_scene("moon")


def test_a_point_needs_three_coordinates():
    with pytest.raises(ValueError, match="x, y, z"):
        plate((0, 0), 1, 1, 0.5)
    assert isinstance(plate((0, 0, 1), 1, 1, 0.5), Surface)
