"""The scenes on which methods may be tuned."""

import numpy as np
from parts import (
    bar,
    box,
    carved,
    checked,
    glints,
    hills,
    patched,
    printed,
    ribs,
    scattered,
    scene,
    stairs,
    striped,
    turn,
    wall,
    wire,
)

from drivers.simulation.scene import Scene, Surface, plate, sphere


def _boxes() -> Scene:
    coats = (checked(0.3, 0.025), striped(0.25, 0.02), patched(0.15, 3, 0.3), None)
    return scene("boxes", wall(2.7, texture=patched(0.3, 1, 0.7)), scattered(11, 12, coats, 1.7, 2.4))


def _cut() -> Scene:
    """Things cut by each border."""
    return scene(
        "cut",
        wall(2.5, texture=patched(0.4, 7, 0.6)),
        box((-0.46, -0.05, 2.0), (0.2, 0.3, 0.1), 0.6, 20, checked(0.4, 0.03)),
        box((0.44, 0.12, 2.1), (0.16, 0.2, 0.1), 0.7, -30, None),
        sphere((0.05, -0.36, 1.9), 0.09, 0.5),
        sphere((-0.12, 0.38, 2.0), 0.11, 0.65, texture=striped(0.4, 0.03)),
        bar((0.2, -0.5, 2.1), (0.34, -0.1, 2.1), 0.02, 0.6),
    )


def _blobs() -> Scene:
    return scene("blobs", hills(0.05, 0.05, 5, patched(0.15, 2, 0.4)))


def _stairs() -> Scene:
    return scene("stairs", stairs(1.9, 0.04, 7, printed(0.12, 4), lying=False))


def _dark() -> Scene:
    """Dark things and dark print in front."""
    return scene(
        "dark",
        wall(2.4, 0.7),
        sphere((-0.2, -0.1, 2.0), 0.12, 0.03),
        box((0.2, 0.05, 2.0), (0.2, 0.3, 0.1), 0.65, -20, printed(0.03, 2, 0.03)),
        bar((-0.4, 0.25, 2.1), (0.1, 0.2, 2.1), 0.03, 0.02),
        plate((0.0, -0.28, 2.2), 0.3, 0.1, 0.05),
    )


def _wires() -> Scene:
    """Round wires and flat bars from a third of a pixel to one and a half, in every direction."""
    random, found = np.random.default_rng(3), list[Surface]()
    for number in range(14):
        angle, z = np.pi * number / 14 + 0.1, random.uniform(1.7, 2.1)
        x, y = random.uniform(-0.3, 0.3), random.uniform(-0.24, 0.24)
        dx, dy = 0.25 * np.cos(angle), 0.25 * np.sin(angle)
        width = (0.0035, 0.006, 0.01, 0.015)[number % 4]
        made = wire if number % 2 else bar
        found.append(made((x - dx, y - dy, z), (x + dx, y + dy, z), width, 0.6))
    return scene("wires", wall(2.5), found)


def _open() -> Scene:
    """Nothing behind."""
    return scene(
        "open",
        sphere((-0.18, 0.0, 2.0), 0.17, 0.6, texture=patched(0.3, 4, 0.3)),
        box((0.2, 0.02, 2.0), (0.22, 0.4, 0.1), 0.6, 25, checked(0.4, 0.03)),
        bar((-0.4, 0.28, 2.0), (0.4, 0.32, 2.0), 0.03, 0.5),
    )


def _slant() -> Scene:
    return scene("slant", hills(0.004, 0.02, 8, patched(0.12, 6, 0.4), tilt=40.0))


def _floor() -> Scene:
    """A floor that runs away into the dark, and a ceiling."""
    return scene(
        "floor",
        plate((0, 0.3, 2.5), 6, 3.4, 0.6, normal=(0, -1, 0), up=(0, 0, 1), texture=patched(0.4, 9, 0.8)),
        plate((0, -0.35, 2.5), 6, 3.4, 0.3, normal=(0, 1, 0), up=(0, 0, 1)),
        box((0.15, 0.2, 2.3), (0.2, 0.2, 0.2), 0.6, 30, None),
    )


def _dusk() -> Scene:
    """A wall that returns hardly any light, relief on it, and lit things before it."""
    return scene(
        "dusk",
        wall(2.7, 0.06, texture=patched(0.5, 27, 0.8)),
        plate((-0.3, 0.15, 2.6), 0.4, 0.5, 0.06).turned(turn("y", 35), (-0.3, 0.15, 2.6)),
        box((-0.1, -0.2, 2.1), (0.22, 0.16, 0.1), 0.7, -25, None),
        sphere((0.28, 0.16, 2.2), 0.1, 0.75),
        bar((0.1, -0.3, 2.0), (0.42, -0.1, 2.05), 0.02, 0.7),
    )


def _net() -> Scene:
    """Laths of a pixel or two, side by side, upright, lying and slanted."""
    laths: list[Surface] = [
        bar((-0.42 + 0.035 * k, -0.3, 2.1), (-0.42 + 0.035 * k, 0.05, 2.1), 0.012, 0.6) for k in range(10)
    ]
    laths += [bar((0.02, -0.3 + 0.04 * k, 2.0), (0.42, -0.3 + 0.04 * k, 2.0), 0.016, 0.7) for k in range(9)]
    laths += [bar((-0.4 + 0.06 * k, 0.1, 2.2), (-0.25 + 0.06 * k, 0.3, 2.2), 0.02, 0.5) for k in range(9)]
    return scene("net", wall(2.7, texture=patched(0.5, 29, 0.9)), laths)


def _brink() -> Scene:
    """A dim slanted wall at the end of the range and beyond it."""
    back = plate((0, 0, 7.45), 16, 8, 0.8, texture=patched(0.6, 33, 1.8)).turned(turn("x", 20), (0, 0, 7.45))
    return scene("brink", back, box((0.5, 0.2, 5.8), (0.7, 0.5, 0.3), 0.8, -15, None))


def _rough() -> Scene:
    """Relief as fine as two pixels."""
    return scene("rough", hills(0.012, 0.016, 41, patched(0.3, 35, 0.4)))


def _ribs() -> Scene:
    """Waves of eight pixels to two, a few millimetres high."""
    return scene("ribs", carved(ribs(0.08, 0.02, 0.5), patched(0.4, 61, 0.4)))


def _gloss() -> Scene:
    """Things that return ten times the light of what is around them."""
    back = wall(2.4, 0.25, texture=patched(0.5, 37, 0.6)).turned(turn("y", 15), (0, 0, 2.4))
    return scene("gloss", back, glints(43, 24, 3.0, 0.4))


TUNING = {
    f.__name__[1:]: f
    for f in (
        _boxes, _cut, _blobs, _stairs, _dark, _wires, _open, _slant, _floor, _dusk, _net, _brink,
        _rough, _ribs, _gloss
    )
}  # fmt: skip
"""Builders by name."""
