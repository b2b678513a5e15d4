"""Walls as a camera with known errors would see them."""

import numpy as np

from service.evaluation.sight import Sight, Take

SHAPE = (72, 88)
FOCAL = 300.0
TILTED = np.array([0.2, -0.1, 1.0])


def matrix(factor=1):
    rows, columns = SHAPE
    centre = ((columns * factor - 1) / 2, (rows * factor - 1) / 2)
    return np.array([[FOCAL * factor, 0, centre[0]], [0, FOCAL * factor, centre[1]], [0, 0, 1.0]])


def blank(factor=1):
    return Sight(np.ones((SHAPE[0] * factor, SHAPE[1] * factor), np.float32), matrix(factor))


def seen(distance, factor=1):
    return Sight(distance.astype(np.float32), matrix(factor))


def wall(away, factor=1, normal=(0, 0, 1.0)):
    """(H, W) true distances of a wall `away` metres off, perpendicularly."""
    unit = np.asarray(normal) / np.linalg.norm(normal)
    return away / (blank(factor).rays @ unit)


def noisy(away, sigma, seed, factor=1, normal=(0, 0, 1.0)):
    true = wall(away, factor, normal)
    return seen(true + np.random.default_rng(seed).normal(0, sigma, true.shape), factor)


def across(factor=1, lean=0.07):
    """(H, W) pixels from a straight line through the middle, > 0 to the right."""
    rows, columns = (size * factor for size in SHAPE)
    i, j = np.indices((rows, columns), dtype=float)
    return (j - columns / 2 - 0.3 - lean * (i - rows / 2)) / np.hypot(1, lean)


def stepped(near, far, width, sigma=0.0, factor=1, lean=0.07):
    """A wall on the left, one farther on the right; between them the distance rises along `width` pixels."""
    share = np.clip(across(factor, lean) / width + 0.5, 0, 1)
    true = wall(near, factor) * (1 - share) + wall(far, factor) * share
    return seen(true + np.random.default_rng(3).normal(0, sigma, true.shape), factor)


def take(before, after):
    return Take(tuple(before), after, None, (0.0, 0.0))
