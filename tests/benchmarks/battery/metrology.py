"""Small experiments with one answer each, as a metrologist would make them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from parts import PIXEL, bar, printed, scene, turn, wall
from rig import BASE, RANGE, Burst, View, capture, look

from drivers.simulation.scene import Scene, plate

Image = NDArray[np.float32]
Reading = tuple[Image, Image | None]
"""(distance, deviation)"""
Fuse = Callable[[Burst], Reading]

FACTOR = BASE.upsampling
CONTRASTS = (1.0, 1.4, 3.0, 10.0, 30.0)
ANGLES = (0, 20, 40, 60, 70)
STEPS = (1, 2, 5, 10, 20, 50)
WIDTHS = (0.5, 1.0, 2.0)
SLANTS = (0, 20, 45)


def printed_wall(fuse: Fuse, seeds: int) -> dict[str, float]:
    """RMS in mm from the truth of a flat wall with text, by contrast, and the bias of the dark dots."""
    found = {}
    for contrast in CONTRASTS:
        off = _errors(scene("print", wall(2.0, texture=printed(1 / contrast))), fuse, seeds)
        found[f"print 1:{contrast:g}"] = float(np.mean([np.sqrt(np.nanmean(o**2)) for o in off]))
    found["bias near print 1:10"] = _bias(fuse)
    return found


def _bias(fuse: Fuse) -> float:
    """mm by which a black square on a white wall stands before the wall around it."""
    made = scene("square", wall(2.0), plate((0, 0, 1.9999), 0.2, 0.2, 0.06))
    (off,) = _errors(made, fuse, 1)
    rows, columns = np.indices(off.shape)
    away = np.maximum(abs(rows - off.shape[0] / 2), abs(columns - off.shape[1] / 2)) / FACTOR
    return float(np.nanmean(off[away < 8]) - np.nanmean(off[(away > 12) & (away < 20)]))


def planarity(fuse: Fuse, seeds: int) -> dict[str, float]:
    """RMS in mm from a plane turned by an angle."""
    found = {}
    for angle in ANGLES:
        made = scene("plane", plate((0, 0, 2.0), 9, 9, 0.6).turned(turn("y", angle), (0, 0, 2.0)))
        off = _errors(made, fuse, seeds)
        found[f"plane {angle}°"] = float(np.mean([np.sqrt(np.nanmean(o**2)) for o in off]))
    return found


def steps(fuse: Fuse, seeds: int) -> dict[str, float]:
    """Measured part of a step's height, and the width (10 to 90 %) and place of the edge, fused cells."""
    found = {}
    for height in STEPS:
        made = scene("step", plate((-1.003, 0, 2.0 - height / 1e3), 2, 4, 0.6), wall(2.0))
        parts, spreads, places = [], [], []
        view = look(made, (FACTOR,))
        for seed in range(seeds):
            part, spread, place = _edge(view, fuse, seed, height)
            parts.append(part)
            spreads.append(spread)
            places.append(place)
        found[f"step {height} mm, part"] = float(np.mean(parts))
        if height >= 10:
            found[f"step {height} mm, spread"] = float(np.mean(spreads))
            found[f"step {height} mm, off place"] = float(np.mean(places))
    return found


def _edge(view: View, fuse: Fuse, seed: int, height: float) -> tuple[float, float, float]:
    distance, _ = fuse(capture(view, BASE, seed))
    truth = view.truth[FACTOR]
    place = int(np.argmax(np.diff(np.median(truth, axis=0)))) + 1
    flat = (distance - truth)[:, place + 8 :]
    profile = np.median(distance - truth + (truth - _plane(truth)), axis=0) - np.median(flat)
    left, right = np.median(profile[place - 40 : place - 12]), np.median(profile[place + 12 : place + 40])
    rise = (profile[place - 20 : place + 20] - left) / (right - left)
    reached = [int(np.argmax(rise > share)) for share in (0.1, 0.5, 0.9)]
    return float(1e3 * (right - left) / height), float(reached[2] - reached[0] + 1), abs(reached[1] - 20.0)


def _plane(truth: Image) -> Image:
    """A wall's distance at 2 m, seen where the truth is."""
    rows, columns = np.indices(truth.shape)
    y, x = (n - (s - 1) / 2 for n, s in zip((rows, columns), truth.shape, strict=True))
    return (2.0 * np.sqrt(1 + (x**2 + y**2) / (200.0 * FACTOR) ** 2)).astype(np.float32)


def bars(fuse: Fuse, seeds: int) -> dict[str, float]:
    """Modulation of a row of bars 0.3 m before a wall, by width in pixels and angle; 1 = full relief."""
    found = {}
    for width in WIDTHS:
        for slant in SLANTS:
            made = _grating(width, slant)
            view = look(made, (FACTOR,))
            front = view.truth[FACTOR] < 2.25
            values = []
            for seed in range(seeds):
                distance, _ = fuse(capture(view, BASE, seed))
                near, far = (_middle(distance, mask) for mask in (front, ~front))
                values.append((far - near) / 0.3)
            found[f"bars {width:g} px {slant}°"] = float(np.mean(values))
    return found


def _grating(width: float, slant: float) -> Scene:
    laths = []
    pitch = max(4.0, 2 * width + 2) * PIXEL
    lean = np.tan(np.radians(slant))
    for k in range(-8, 9):
        x = k * pitch / np.cos(np.radians(slant))
        laths.append(bar((x - 0.3 * lean, 0.3, 2.0), (x + 0.3 * lean, -0.3, 2.0), width * PIXEL, 0.6))
    return scene("bars", wall(2.3), laths)


def _middle(distance: Image, mask: NDArray[np.bool_]) -> float:
    """Mean distance of a mask's cells in the middle of the image; unknown ones are taken for half-way."""
    inner = np.zeros_like(mask)
    inner[60:-60, 60:-60] = True
    return float(np.mean(np.nan_to_num(distance[mask & inner], nan=2.15)))


def repeatability(fuse: Fuse, seeds: int) -> dict[str, float]:
    """Deviation over bursts of a printed wall's cells over the stated one, median; 1 = as stated."""
    view = look(scene("print", wall(2.0, texture=printed(1 / 3))), (FACTOR,))
    maps, stated = zip(*(fuse(capture(view, replace(BASE), seed)) for seed in range(seeds + 2)), strict=True)
    if stated[0] is None:
        return {}
    ratio = np.nanstd(np.stack(maps), axis=0, ddof=1) / np.nanmean(np.stack(stated), axis=0)
    return {"repeatability / stated": float(np.nanmedian(ratio))}


def _errors(made: Scene, fuse: Fuse, seeds: int) -> list[Image]:
    """mm, by seed."""
    view = look(made, (FACTOR,))
    maps = (fuse(capture(view, BASE, seed))[0] for seed in range(seeds))
    return [1e3 * ((m - view.truth[FACTOR] + RANGE / 2) % RANGE - RANGE / 2) for m in maps]


EXPERIMENTS = {f.__name__: f for f in (printed_wall, planarity, steps, bars, repeatability)}
