"""Compiling ahead: the first call of a Numba kernel takes seconds, later ones nothing."""

import numpy as np

from solver.fusion import fuse
from solver.options import FusionOptions, Method
from solver.runtime.ahead import compile_ahead

_COMPILED: tuple[Method, ...] = ("lidarboost", "area", "phasor")


def warm_up() -> None:
    """Compile (or load from the disk cache) every kernel that fusing and registering need.

    On a new machine that takes a minute of two processors; from the cache, half a second.
    """
    rows, columns = np.mgrid[0:24, 0:32].astype(np.float32)
    frame = 2 + 0.2 * np.sin(rows / 3) * np.cos(columns / 4)
    frames = np.stack([frame, np.roll(frame, 1, axis=0), frame])
    frames[1, 4, 4] = np.nan
    light = np.full_like(frames, 1000.0)
    intrinsics = np.array([[40.0, 0, 15.5], [0, 40.0, 11.5], [0, 0, 1]])
    for method in _COMPILED:
        compile_ahead(method)
        options = FusionOptions(method=method, regularization=0.01)
        fuse(frames, light, options=options, shifts=np.zeros((3, 2)), ambiguity_range=7.5)
    options = FusionOptions(method="lidarboost", regularization=0.01)
    for matrix in (None, intrinsics):
        fuse(frames, light, options=options, initial=np.zeros((3, 2)), intrinsics=matrix, ambiguity_range=7.5)
