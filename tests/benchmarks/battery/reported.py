"""The scenes that are only ever reported on; nothing is to be tuned with them."""

import numpy as np
from parts import (
    bar,
    box,
    carved,
    checked,
    cobbles,
    glints,
    hatched,
    hills,
    patched,
    printed,
    scattered,
    scene,
    stairs,
    striped,
    turn,
    wall,
    wire,
)

from drivers.simulation import build_scene, textures
from drivers.simulation.scene import Holes, Scene, Surface, Texture, disc, frustum, plate, sphere


def _clutter() -> Scene:
    coats = (patched(0.2, 13, 0.25), None, checked(0.2, 0.018), printed(0.3, 5))
    back = Texture(textures.grain(0.4, 9), (0.8, 0.8))
    return scene("clutter", wall(3.1, texture=back), scattered(29, 15, coats, 1.6, 2.8))


def _frame() -> Scene:
    """Other things cut by the borders."""
    return scene(
        "frame",
        wall(2.9, texture=checked(0.5, 0.09)),
        frustum((-0.42, 0.0, 2.0), (0.06, 0.09), 0.9, 0.6),
        plate((0.1, -0.38, 2.1), 0.3, 0.14, 0.5, texture=patched(0.2, 15, 0.2)),
        plate((0.47, 0.05, 2.2), 0.12, 0.4, 0.65).turned(turn("y", 35), (0.47, 0, 2.2)),
        disc((-0.1, 0.37, 1.9), 0.1, 0.55),
        wire((0.25, 0.1, 1.9), (0.32, 0.5, 1.9), 0.012, 0.6),
    )


def _waves() -> Scene:
    return scene("waves", hills(0.03, 0.035, 21, patched(0.1, 17, 0.3, 120)))


def _treads() -> Scene:
    return scene("treads", stairs(2.0, 0.06, 5, printed(0.2, 9, 0.012), lying=True))


def _bright() -> Scene:
    """Bright things before a dark wall."""
    return scene(
        "bright",
        wall(2.9, 0.05),
        sphere((-0.22, -0.08, 2.1), 0.13, 0.8),
        box((0.15, 0.1, 2.2), (0.2, 0.2, 0.12), 0.8, 30, None),
        bar((0.05, -0.3, 2.0), (0.4, -0.15, 2.0), 0.015, 0.8),
        disc((0.3, -0.02, 2.3), 0.06, 0.7),
    )


def _soot() -> Scene:
    """Dark objects before a bright wall, with bright print on them."""
    label = Texture(textures.label(0.03), (0.25, 0.25))
    return scene(
        "soot",
        wall(2.6, 0.75, texture=striped(0.5, 0.05)),
        frustum((-0.2, 0.05, 2.1), (0.1, 0.07), 0.35, 0.04),
        box((0.18, -0.05, 2.1), (0.25, 0.25, 0.1), 0.6, 15, label),
        sphere((0.05, 0.28, 1.95), 0.07, 0.025),
    )


def _fence() -> Scene:
    """A lattice, a comb and slanted laths."""
    mesh = Holes((0.05, 0.05), (0.02, 0.02), (0.19, 0.16), round=False)
    laths: list[Surface] = [
        bar((0.02 + 0.045 * k, 0.3, 2.1), (0.12 + 0.045 * k, -0.05, 2.1), 0.012, 0.6) for k in range(7)
    ]
    needles = [
        wire((0.02 + 0.04 * k, -0.32, 2.2), (0.02 + 0.04 * k, -0.08, 2.2), 0.007, 0.7) for k in range(8)
    ]
    return scene(
        "fence",
        wall(2.8, texture=patched(0.5, 19, 0.9)),
        plate((-0.22, 0.0, 2.0), 0.4, 0.34, 0.6, holes=mesh),
        laths,
        needles,
    )


def _sky() -> Scene:
    """Nothing behind, and a floor that runs away."""
    return scene(
        "sky",
        plate((0, 0.25, 3.0), 6, 3.4, 0.5, normal=(0, -1, 0), up=(0, 0, 1), texture=checked(0.4, 0.12)),
        frustum((-0.2, 0.05, 2.1), (0.08, 0.05), 0.4, 0.6, axis=(0, -1, 0)),
        sphere((0.16, -0.1, 2.2), 0.12, 0.55, texture=patched(0.2, 23, 0.2)),
        wire((-0.4, -0.3, 2.0), (0.4, -0.22, 2.0), 0.02, 0.6),
    )


def _far() -> Scene:
    """A slanted wall through the ambiguity range, at which distances wrap."""
    back = plate((0, 0, 7.3), 14, 8, 0.9, texture=patched(0.5, 25, 1.5)).turned(turn("y", 30), (0, 0, 7.3))
    return scene(
        "far",
        back,
        box((-0.6, 0.1, 5.5), (0.6, 0.6, 0.3), 0.8, 20, None),
        sphere((0.5, -0.2, 6.0), 0.35, 0.8, texture=striped(0.5, 0.08)),
    )


def _desk() -> Scene:
    """Shallow things on a slanted plane with print."""
    ground = plate((0, 0, 2.1), 3, 3, 0.6, texture=printed(0.15, 11)).turned(turn("x", -45), (0, 0, 2.1))
    random, things = np.random.default_rng(31), list[Surface]()
    for _ in range(6):
        x, y = random.uniform(-0.3, 0.3), random.uniform(-0.22, 0.22)
        things += box((x, y, 2.1 + y - 0.02), (0.1, 0.06, 0.08), random.uniform(0.2, 0.7), 40, None)
    return scene("desk", ground, things)


def _cobbles() -> Scene:
    """Rounded stones beside and over each other."""
    return scene("cobbles", wall(2.1, 0.4), cobbles(47, 160, 0.025, 0.07))


def _carving() -> Scene:
    """Hatched squares of an eighth of a metre, waves of two pixels to six."""
    return scene("carving", carved(hatched(63, 8, 0.02, 0.06, 0.5), patched(0.4, 65, 0.4)))


def _lamps() -> Scene:
    """Small bright things before a dim wall, and on posts."""
    posts = [bar((-0.35 + 0.1 * k, 0.4, 1.9), (-0.35 + 0.1 * k, -0.1, 1.9), 0.015, 0.5) for k in range(7)]
    return scene("lamps", wall(2.5, 0.2), glints(51, 20, 5.0, 0.25), posts)


def _wedges() -> Scene:
    return build_scene("wedges")


def _objects() -> Scene:
    return build_scene("objects")


REPORTED = {
    f.__name__[1:]: f
    for f in (
        _clutter, _frame, _waves, _treads, _bright, _soot, _fence, _sky, _far, _desk, _cobbles,
        _carving, _lamps, _wedges, _objects
    )
}  # fmt: skip
"""Builders by name; `wedges` and `objects` are those of the bundled recordings, in the smaller view."""
