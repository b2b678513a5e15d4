"""Reliefs against geometry worked out by hand, and what the pictures hold."""

import numpy as np
import pytest

from drivers.simulation import textures
from drivers.simulation.cast import cast
from drivers.simulation.scene import Relief, Scene, plate

GRID = np.linspace(-0.2, 0.2, 81)
X, Y = np.meshgrid(GRID, GRID)


def look(surface):
    step = GRID[1] - GRID[0]
    packed = Scene("test", [surface]).packed()
    return cast(packed, np.zeros(3), np.eye(3), (GRID[0], GRID[0]), (step, step), X.shape)


def test_a_relief_stands_where_its_heights_say_and_shades_by_its_slope():
    side = textures.SIDE
    u = (np.arange(side) + 0.5) / side - 0.5
    heights = (0.05 * np.cos(2 * np.pi * u))[None] * np.ones((side, 1))  # one period over 2 m, towards us
    distance, strength = look(plate((0, 0, 2.0), 2.0, 2.0, 0.6, relief=Relief(heights.astype(np.float32))))
    length = np.sqrt(1 + X**2 + Y**2)
    z = distance / length
    expected = 2.0 - 0.05 * np.cos(np.pi * X * z)
    np.testing.assert_allclose(z, expected, atol=2e-5)
    slope = 0.05 * np.pi * np.sin(np.pi * X * z)  # of z along x
    cosine = np.abs(1 - slope * X) / np.sqrt(1 + slope**2) / length
    np.testing.assert_allclose(strength * distance**2 / 0.6, cosine, rtol=5e-3)


@pytest.mark.parametrize("dark", [1.0, 1 / 3, 1 / 30])
def test_pictures_span_their_contrast(dark):
    pictures = (
        textures.patches(60, dark, 1),
        textures.text(dark, 4, 1),
        textures.checks(8, dark),
        textures.stripes(8, dark),
    )
    for image in pictures:
        assert image.shape == (textures.SIDE, textures.SIDE)
        assert image.min() == pytest.approx(dark)
        assert image.max() == 1


def test_pictures_are_the_same_for_the_same_seed_and_others_for_another():
    for draw in (
        lambda seed: textures.patches(30, 0.2, seed),
        lambda seed: textures.text(0.2, 4, seed),
        lambda seed: textures.waves(0.01, seed, 0.05),
    ):
        np.testing.assert_array_equal(draw(1), draw(1))
        assert (draw(1) != draw(2)).any()


def test_waves_have_the_height_asked_for():
    assert textures.waves(0.02, 3, 0.05).std() == pytest.approx(0.02)
