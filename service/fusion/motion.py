"""Whether the frames say that the camera turned as far as its stage says: one gain an axis.

The rotation vectors that were found in the images, r_k, are fitted by those that the stage's angles give,
split into what pan and what tilt turn: r_k = g_pan p_k + g_tilt t_k + c (least squares over x and y; c takes
up the error of the frame that all others refer to). A gain is 1 where the stage does as it says, 0 where it
does not move, and negative where it turns the wrong way; its deviation is that of the fit's residuals.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.poses import relative_rotations
from service.messages.report import AxisGain, MotionFound

_FEWEST = 4
"""Frames that tell something of two gains and an offset."""

_LEAST = 0.1
"""Low-resolution pixels, RMS, that an axis must turn the image by to be judged: ten times what a registration
errs by, and more than the pointing error of usual stages."""

_NOISE = 0.01
"""Low-resolution pixels: what a registration errs by at least, whatever its residuals say."""


def found_motion(
    rotations: NDArray[np.float64], frames: Sequence[Frame], calibration: Calibration
) -> MotionFound | None:
    """How far the camera turned for what the stage says, by axis; None where that cannot be judged.

    Args:
        rotations: (N, 3) found in the frames, radians, camera axes.
        frames: N, with the stage's angles.
        calibration: of the camera, on its stage.
    """
    if len(frames) < _FEWEST:
        return None
    pixel = 1.0 / max(calibration.intrinsics.fx, calibration.intrinsics.fy)
    columns = [_turns(frames, calibration, axis) for axis in ("pan", "tilt")]
    moved = [bool(np.sqrt((turn**2).sum(1).mean()) >= _LEAST * pixel) for turn in columns]
    if not any(moved):
        return None
    design = np.stack([turn.ravel() for turn, moves in zip(columns, moved, strict=True) if moves], axis=1)
    found = rotations[:, :2] - rotations[:, :2].mean(0)
    gains, _, rank, _ = np.linalg.lstsq(design, found.ravel(), rcond=1e-3)
    if rank < design.shape[1]:  # pan and tilt turn together: neither can be told from the other
        return None
    residual = found.ravel() - design @ gains
    freedom = max(1, len(residual) - design.shape[1] - 2)
    variance = max(float(residual @ residual) / freedom, (_NOISE * pixel) ** 2)
    spread = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    judged = iter(
        AxisGain(gain=float(gain), deviation=float(one)) for gain, one in zip(gains, spread, strict=True)
    )
    pan, tilt = (next(judged) if moves else None for moves in moved)
    return MotionFound(pan=pan, tilt=tilt)


def _turns(frames: Sequence[Frame], calibration: Calibration, axis: str) -> NDArray[np.float64]:
    """(N, 2) what one axis alone turns the camera by, about x and y, less the mean."""
    first = frames[0]
    angles = [(f.pan, first.tilt) if axis == "pan" else (first.pan, f.tilt) for f in frames]
    turns = relative_rotations(angles, calibration.mount)[:, :2]
    return np.asarray(turns - turns.mean(0))
