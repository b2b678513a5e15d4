"""The normal equations of a Gauss–Newton step of every frame against the mosaic."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.kernels.normal_equations import sum_frames
from solver.registration.grid import Place
from solver.registration.mosaic import Mosaic
from solver.registration.motion import Motion
from solver.registration.point_samples import Points
from solver.runtime import team

Float = NDArray[np.float64]

POSITION_ERROR = 0.05  # pixels; the mosaic's error beside an edge, as a displacement
BLOCK = 512  # samples at a time, which stay in the nearest cache


@dataclass(frozen=True, slots=True)
class Equations:
    """Per frame: normal matrix (N, 3, 3), what the mosaic's noise alone adds to it, right side (N, 3).

    `overlap` is the share of the frame's used samples that the mosaic covers; `misfit` the mean residual in
    deviations, each cut at 4, where the mosaic is steep.
    """

    matrix: Float
    noise: Float
    right: Float
    overlap: Float
    misfit: Float


def normal_equations(
    points: Points, place: Place, mosaic: Mosaic, motion: Motion, position_error: float
) -> Equations:
    """Linearise y ≈ U(p(θ + δ)) for every frame.

    A residual's variance is σ² + (e |∇U|)², e the mosaic's own error as a displacement: without it a handful
    of strong edges decides. Slopes are central differences: the cells' own would lean towards one node, and a
    frame whose pixels all sit alike on the grid, as the reference's do, would be pulled along. Of samples
    that are bent, those of a row or column share errors (see `kernels.normal_equations`), so that a frame is
    one block.
    """
    count, bent = len(points.first) - 1, points.bent
    sums, counts = np.zeros((count, 15)), np.zeros((count, 3))
    team.hand_out(
        len(points.weights),
        sum_frames,
        points.values,
        points.weights,
        *place,
        points.pixel,
        points.first,
        mosaic.values,
        mosaic.kind,
        mosaic.misfit if mosaic.misfit is not None else np.ones((1, 1), np.float32),
        np.array([*mosaic.grid.origin, mosaic.grid.density], dtype=np.float32),
        motion.camera(points.level).astype(np.float32),
        motion.rotational,
        np.float32(position_error**2),
        max(1, int(np.diff(points.first).max())) if bent else BLOCK,
        points.shape,
        bent,
        sums,
        counts,
    )
    seen, trust, misfit = counts.T
    return Equations(
        _symmetric(sums[:, :6]),
        _symmetric(sums[:, 9:]) * mosaic.slope_noise,
        sums[:, 6:9],
        seen / np.maximum(np.diff(points.first), 1),
        misfit / np.maximum(trust, 1e-9),
    )


def _symmetric(upper: Float) -> Float:
    return upper[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
