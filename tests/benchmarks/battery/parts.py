"""What the scenes of the battery are built of; 2 m away a pixel covers 10 mm, the view 0.88 m."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.simulation import textures
from drivers.simulation.scene import Relief, Scene, Surface, Texture, disc, frustum, plate, sphere

Point = tuple[float, float, float]
PIXEL = 0.01
"""m that a pixel covers 2 m away."""

SLAB = 1.2
"""m of a carved slab, which is more than the camera sees from any pose."""


def turn(axis: str, degrees: float) -> NDArray[np.float64]:
    """(3, 3) rotation about an axis."""
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


def wall(z: float, reflectivity: float = 0.6, texture: Texture | None = None) -> Surface:
    """Across the view."""
    return plate((0, 0, z), 8, 8, reflectivity, texture=texture)


def patched(dark: float, seed: int, side: float = 0.5, count: int = 80) -> Texture:
    """Random patches that know nothing of the geometry."""
    return Texture(textures.patches(count, dark, seed), (side, side))


def printed(dark: float, seed: int = 1, dot: float = 0.8 * PIXEL) -> Texture:
    """Text of dots of that many metres."""
    texels = 4
    return Texture(textures.text(dark, texels, seed), (dot * textures.SIDE / texels,) * 2)


def checked(dark: float, cell: float) -> Texture:
    """Checks with cells of that many metres."""
    return Texture(textures.checks(8, dark), (8 * cell, 8 * cell))


def striped(dark: float, width: float) -> Texture:
    """Upright stripes of that many metres."""
    return Texture(textures.stripes(8, dark), (16 * width, 16 * width))


def box(
    centre: Point, size: Point, reflectivity: float, yaw: float, texture: Texture | None
) -> list[Surface]:
    """The five sides of a box that can be seen, turned about the upright."""
    x, y, z = centre
    w, h, d = size
    faces = [
        plate((x, y, z - d / 2), w, h, reflectivity, texture=texture),
        plate((x - w / 2, y, z), d, h, reflectivity, normal=(-1, 0, 0), texture=texture),
        plate((x + w / 2, y, z), d, h, reflectivity, normal=(1, 0, 0), texture=texture),
        plate((x, y - h / 2, z), w, d, reflectivity, normal=(0, -1, 0), up=(0, 0, 1), texture=texture),
        plate((x, y + h / 2, z), w, d, reflectivity, normal=(0, 1, 0), up=(0, 0, 1), texture=texture),
    ]
    return [face.turned(turn("y", yaw), centre) for face in faces]


def bar(start: Point, end: Point, width: float, reflectivity: float) -> Surface:
    """A flat bar that faces the camera."""
    a, b = np.array(start), np.array(end)
    along = b - a
    return plate((a + b) / 2, width, float(np.linalg.norm(along)), reflectivity, normal=(0, 0, -1), up=along)


def wire(start: Point, end: Point, width: float, reflectivity: float) -> Surface:
    """A round wire."""
    a, b = np.array(start), np.array(end)
    length = float(np.linalg.norm(b - a))
    return frustum((a + b) / 2, (width / 2, width / 2), length, reflectivity, axis=(b - a) / length)


def stairs(first: float, step: float, count: int, texture: Texture | None, lying: bool) -> list[Surface]:
    """Treads side by side, each `step` metres farther and reaching behind the one before."""
    treads: list[Surface] = []
    wide = (0.9 if not lying else 0.76) / count
    for k in range(count):
        hidden = 0.04 if k else 0.5
        at = (k + 0.5) * wide - count * wide / 2 - hidden / 2
        z = first + k * step
        centre = (0.0, at, z) if lying else (at, 0.0, z)
        size = (3.0, wide + hidden) if lying else (wide + hidden, 3.0)
        treads.append(plate(centre, size[0], size[1], 0.6, texture=texture))
    return [*treads, wall(first + count * step, texture=texture)]


def hills(height: float, finest: float, seed: int, texture: Texture | None, tilt: float = 0.0) -> Surface:
    """A wall 2 m away with smooth irregular heights, turned about the upright."""
    ground = plate(
        (0, 0, 2.0), 1.6, 1.6, 0.6, texture=texture, relief=Relief(textures.waves(height, seed, finest))
    )
    return ground.turned(turn("y", tilt), (0, 0, 2.0))


def carved(heights: NDArray[np.float32], texture: Texture | None) -> Surface:
    """A slab of `SLAB` metres 2 m away with these heights."""
    return plate((0, 0, 2.0), SLAB, SLAB, 0.6, texture=texture, relief=Relief(heights))


def ribs(longest: float, shortest: float, steepness: float) -> NDArray[np.float32]:
    """Upright waves of a slab whose lengths (m) fall from left to right, as steep everywhere."""
    at = np.arange(textures.SIDE) / textures.SIDE
    lengths = longest * (shortest / longest) ** at
    phase = np.cumsum(2 * np.pi / lengths) * SLAB / textures.SIDE
    waves = steepness * lengths * np.sin(phase) / (2 * np.pi)
    return np.broadcast_to(waves, (textures.SIDE, textures.SIDE)).astype(np.float32)


def hatched(seed: int, side: int, shortest: float, longest: float, steepness: float) -> NDArray[np.float32]:
    """Squares (side × side over a slab) of waves of their own direction and length, m; some are level."""
    random = np.random.default_rng(seed)
    v, u = np.mgrid[: textures.SIDE, : textures.SIDE] / textures.SIDE
    found = np.zeros_like(u)
    for row, column in np.ndindex(side, side):
        angle, length = random.uniform(0, np.pi), random.uniform(shortest, longest)
        inside = (v * side // 1 == row) & (u * side // 1 == column)
        phase = 2 * np.pi * SLAB * (v * np.sin(angle) + u * np.cos(angle)) / length
        found += (random.random() < 0.75) * inside * steepness * length / (2 * np.pi) * np.sin(phase)
    return found.astype(np.float32)


def scattered(
    seed: int, count: int, coats: Sequence[Texture | None], near: float, far: float
) -> list[Surface]:
    """Balls and boxes anywhere in view."""
    random = np.random.default_rng(seed)
    found: list[Surface] = []
    for number in range(count):
        z = random.uniform(near, far)
        x, y = random.uniform(-0.2, 0.2) * z, random.uniform(-0.16, 0.16) * z
        size, shade = random.uniform(0.04, 0.13), random.uniform(0.25, 0.8)
        coat = coats[number % len(coats)]
        if number % 2:
            found.append(sphere((x, y, z), size, shade, texture=coat))
        else:
            found += box((x, y, z), (2 * size, 1.6 * size, size), shade, random.uniform(-50, 50), coat)
    return found


def cobbles(seed: int, count: int, least: float, most: float) -> list[Surface]:
    """Stones of those radii (m), half sunk into a wall 2.1 m away, each of its own shade."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        x, y = random.uniform(-0.5, 0.5), random.uniform(-0.42, 0.42)
        centre = (x, y, 2.1 + random.uniform(-0.01, 0.02))
        found.append(sphere(centre, random.uniform(least, most), random.uniform(0.2, 0.8)))
    return found


def glints(seed: int, count: int, reflectivity: float, standing: float) -> list[Surface]:
    """Discs of a third of a pixel to three that return much light; every other one `standing` m in front."""
    random = np.random.default_rng(seed)
    found = []
    for number in range(count):
        z = 2.3 - standing * (number % 2)
        x, y = random.uniform(-0.2, 0.2) * z, random.uniform(-0.16, 0.16) * z
        found.append(disc((x, y, z), random.uniform(0.004, 0.03), reflectivity))
    return found


def scene(name: str, *surfaces: Surface | list[Surface]) -> Scene:
    """One scene of surfaces and lists of them."""
    every: list[Surface] = []
    for item in surfaces:
        every += item if isinstance(item, list) else [item]
    return Scene(name, every)
