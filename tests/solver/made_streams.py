"""Frames of a tilted wall with a block before it, each from another place."""

import numpy as np

ROWS, COLUMNS = 20, 24


def long_stream(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames (N, H, W) of the block, with fresh noise, their amplitudes and their shifts."""
    rng = np.random.default_rng(8)
    shifts = rng.uniform(-0.7, 0.7, size=(count, 2))
    shifts[0] = 0
    rows, columns = np.mgrid[0:ROWS, 0:COLUMNS]
    stack = []
    for dy, dx in shifts:
        y, x = rows + dy, columns + dx
        block = np.clip(y - 5, 0, 1) * np.clip(14 - y, 0, 1) * np.clip(x - 6, 0, 1) * np.clip(16 - x, 0, 1)
        stack.append(2.0 + 0.01 * x - 0.5 * block + 0.005 * rng.normal(size=block.shape))
    return np.array(stack, np.float32), np.full((count, ROWS, COLUMNS), 1000, np.float32), shifts
