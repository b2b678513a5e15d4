"""Bursts of a made scene, with its truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Burst:
    """Frames (N, H, W) of a scene, their exact shifts, and the truth at four times the size."""

    distance: np.ndarray
    shifts: np.ndarray
    truth: np.ndarray


RAYS = 12
"""Rays per low-resolution pixel and axis."""


def depth(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A curved, tilted wall with a ball, a disc and a thin post in front; metres over pixels."""
    wall = 2.0 + 0.3 * np.sin(x / 30) + 0.004 * y
    ball = (y - 20) ** 2 + (x - 20) ** 2
    wall = np.where(ball < 144, 1.4 + 0.2 * ball / 144, wall)
    wall = np.where((y - 38) ** 2 + (x - 48) ** 2 < 100, 1.6, wall)
    return np.where(np.abs(x - 40 - 0.1 * y) < 1.2, 1.3, wall)


def burst(
    noise: float,
    *,
    frames: int = 10,
    rows: int = 52,
    columns: int = 60,
    seed: int = 0,
    depth: Callable[[np.ndarray, np.ndarray], np.ndarray] = depth,
) -> Burst:
    """Average the scene over every pixel's footprint and add noise."""
    rng = np.random.default_rng(seed)
    shifts = rng.uniform(-1.5, 1.5, (frames, 2))
    shifts[0] = 0
    offset = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    stack = []
    for dy, dx in shifts:
        y = (np.arange(rows)[:, None] + offset + dy).ravel()
        x = (np.arange(columns)[:, None] + offset + dx).ravel()
        stack.append(depth(y[:, None], x[None]).reshape(rows, RAYS, columns, RAYS).mean(axis=(1, 3)))
    distance = np.array(stack) + noise * rng.normal(size=(frames, rows, columns))
    y, x = (np.arange(4 * rows) + 0.5) / 4 - 0.5, (np.arange(4 * columns) + 0.5) / 4 - 0.5
    return Burst(distance.astype(np.float32), shifts, depth(y[:, None], x[None]))
