"""The scenes by name: the two of the LidarBoost paper (its Figs. 1 and 5), and plain ones for tests.

Coordinates are stage axes: the camera at the origin looks along z; at 2.5 m one pixel of an SR3000 covers
12.5 mm, a fused pixel (×4) 3.1 mm. Sizes are chosen around these: bars and points thinner than a pixel.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.errors import InitialisationError
from drivers.simulation import textures
from drivers.simulation.board import board_scene
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

PLASTER, WOOD, CARD, BLACK = 0.6, 0.7, 0.65, 0.015
"""Reflectivities in the near infrared; black print of carbon ink returns one or two per cent."""

Point = tuple[float, float, float]


def build_scene(name: str) -> Scene:
    """The scene of that name; raises `InitialisationError` where there is none."""
    if name not in SCENES:
        raise InitialisationError(f"no scene is called {name!r}; there are: {', '.join(SCENES)}")
    return Scene(name, SCENES[name]())


def plane_scene(away: float = 2.0) -> list[Surface]:
    """A bare wall, square to the camera at rest."""
    return [plate((0, 0, away), 10 * away, 10 * away, 0.6)]


def _step() -> list[Surface]:
    near = plate((-5.0, 0, 2.0), 10, 20, 0.6)
    return [near, plate((0, 0, 2.5), 20, 20, 0.6)]


def _sphere() -> list[Surface]:
    return [sphere((0, 0, 2.5), 0.5, 0.6), plate((0, 0, 3.5), 20, 20, 0.6)]


def _wedges() -> list[Surface]:
    """Thin wedges at three depths, two panels with holes, a slatted one, and one that recedes."""
    grained = Texture(textures.grain(0.3, 3, stretch=4), (0.4, 0.4))
    base = 0.62
    surfaces = _room(back=3.3, floor=base)
    for number in range(9):
        x = -0.86 + 0.115 * number
        z = (2.25, 2.5, 2.75)[number % 3]
        surfaces += _spike((x, base, z), 0.075 - 0.004 * number, 0.95 - 0.05 * (number % 4), grained)
    round_holes = Holes((0.088, 0.088), (0.030, 0.030), (0.19, 0.28))
    slits = Holes((0.060, 0.40), (0.016, 0.17), (0.22, 0.21), round=False)
    surfaces += [
        plate((0.42, 0.12, 2.35), 0.50, 0.70, WOOD, holes=round_holes, texture=grained),
        plate((0.95, 0.20, 2.6), 0.52, 0.84, 0.5, holes=slits, texture=grained).turned(
            _turn("y", 28), (0.95, 0, 2.6)
        ),
        plate((-0.55, -0.55, 2.55), 0.9, 0.16, WOOD, texture=grained).turned(
            _turn("y", 40), (-0.55, 0, 2.55)
        ),
        plate((0.35, -0.55, 2.2), (0.02, 0.30), 0.32, 0.55),
        plate((0.75, -0.52, 2.9), 0.36, 0.36, WOOD, holes=Holes((0.05, 0.05), (0.014, 0.014), (0.14, 0.14))),
    ]
    return surfaces


def _objects() -> list[Surface]:
    """On a table: a ball, a basket with holes, a cup, a box whose black print returns hardly any light."""
    plain = Texture(textures.grain(0.2, 4), (0.7, 0.7))
    weave = Holes((0.062, 0.058), (0.021, 0.019), (9.0, 0.13), round=False)
    top = 0.36
    table = plate((0, top, 2.6), 2.3, 1.3, 0.55, normal=(0, -1, 0), up=(0, 0, 1), texture=plain)
    edge = plate((0, top + 0.02, 1.95), 2.3, 0.04, 0.5)
    ball = Texture(textures.stripes(6, 0.72), (2 * np.pi * 0.24, 2 * np.pi * 0.24))
    printed = Texture(textures.label(BLACK / CARD), (0.46, 0.52))
    poster = Texture(textures.checks(6, 0.35), (0.9, 0.6))
    basket = (0.22, top - 0.20, 2.75)
    return [
        *_room(back=3.4, floor=1.1),
        table,
        edge,
        plate((-0.35, -0.75, 3.38), 0.9, 0.6, 0.8, texture=poster),
        sphere((-0.66, top - 0.24, 2.35), 0.24, 0.75, texture=ball),
        frustum(basket, (0.20, 0.27), 0.40, 0.62, holes=weave),
        disc((basket[0], top - 0.005, basket[2]), 0.20, 0.62, normal=(0, -1, 0)),
        sphere((basket[0] + 0.05, top - 0.12, basket[2]), 0.10, 0.5),
        *_cup((-0.20, top, 2.12)),
        *_box((0.70, top - 0.26, 2.40), (0.46, 0.52, 0.24), CARD, yaw=-24, front=printed),
    ]


SCENES: dict[str, Callable[[], list[Surface]]] = {
    "wedges": _wedges,
    "objects": _objects,
    "plane": plane_scene,
    "step": _step,
    "sphere": _sphere,
    "board": board_scene,
}
"""Scene builders by name. `plane`: a wall at 2 m; `step`: 2 m on the left, 2.5 m on the right; `sphere`: a
ball of 0.5 m radius at 2.5 m before a wall at 3.5 m; all of reflectivity 0.6. `board`: to calibrate with."""


def _turn(axis: str, degrees: float) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


def _room(back: float, floor: float) -> list[Surface]:
    """Six walls, so that every ray comes back: the back wall at z = `back`, the floor at y = `floor`."""
    plaster = Texture(textures.grain(0.35, 1), (1.6, 1.6))
    boards = Texture(textures.grain(0.5, 2, stretch=8), (0.9, 0.9))
    half, ceiling = 2.4, -2.0
    middle, height = (floor + ceiling) / 2, floor - ceiling
    return [
        plate((0, middle, back), 2 * half, height, PLASTER, texture=plaster),
        plate((0, middle, -back), 2 * half, height, PLASTER, normal=(0, 0, 1)),
        plate((half, middle, 0), 2 * back, height, PLASTER, normal=(-1, 0, 0), texture=plaster),
        plate((-half, middle, 0), 2 * back, height, PLASTER, normal=(1, 0, 0), texture=plaster),
        plate((0, floor, 0), 2 * half, 2 * back, 0.45, normal=(0, -1, 0), up=(0, 0, 1), texture=boards),
        plate((0, ceiling, 0), 2 * half, 2 * back, 0.8, normal=(0, 1, 0), up=(0, 0, 1)),
    ]


def _box(centre: Point, size: Point, reflectivity: float, yaw: float, front: Texture) -> list[Surface]:
    """A closed box, turned by `yaw` degrees about the vertical; `front` is the picture on its near side."""
    x, y, z = centre
    w, h, d = size
    faces = [
        plate((x, y, z - d / 2), w, h, reflectivity, texture=front),
        plate((x, y, z + d / 2), w, h, reflectivity, normal=(0, 0, 1)),
        plate((x - w / 2, y, z), d, h, reflectivity, normal=(-1, 0, 0)),
        plate((x + w / 2, y, z), d, h, reflectivity, normal=(1, 0, 0)),
        plate((x, y - h / 2, z), w, d, reflectivity, normal=(0, -1, 0), up=(0, 0, 1)),
        plate((x, y + h / 2, z), w, d, reflectivity, normal=(0, 1, 0), up=(0, 0, 1)),
    ]
    return [face.turned(_turn("y", yaw), centre) for face in faces]


def _spike(foot: Point, width: float, height: float, grained: Texture) -> list[Surface]:
    """A thin wedge: two flanks that meet in an edge towards the camera and run into a point on top."""
    x, y, z = foot
    ridge, tip = (x, y, z - width), (x, y - height, z)
    left, right = (x - width / 2, y, z), (x + width / 2, y, z)
    return [
        triangle(left, ridge, tip, WOOD, texture=grained),
        triangle(ridge, right, tip, WOOD, texture=grained),
    ]


def _cup(foot: Point) -> list[Surface]:
    """A mug of 16 cm with a handle of six short tubes on its right."""
    x, y, z = foot
    body = frustum((x, y - 0.08, z), (0.060, 0.075), 0.16, 0.85)
    bottom = disc((x, y - 0.004, z), 0.0595, 0.85, normal=(0, -1, 0))
    angles = np.radians(np.linspace(-80, 80, 7))
    ring = np.stack([x + 0.07 + 0.045 * np.cos(angles), y - 0.085 + 0.05 * np.sin(angles)], axis=1)
    handle = [
        frustum(
            (*((a + b) / 2), z), (0.009, 0.009), float(np.hypot(*(b - a))) + 0.004, 0.85, axis=(*(b - a), 0)
        )
        for a, b in pairwise(ring)
    ]
    return [body, bottom, *handle]
