"""Where a camera looked, from transforms: pan and tilt of a stage that would have turned it so."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Mount
from drivers.depth.transforms import TransformTree
from drivers.importers.exposure import Findings
from drivers.messages import RIG_FROM_STAGE
from drivers.poses import stage_rotation

_ROLLED = 2e-3
"""Radians about the optical axis that a pan-tilt stage would not make; half a pixel at the edge of 500."""
_MOVED = 5e-3
"""Metres that the camera may move while it turns; 2 px of parallax at 1 m, with a focal length of 500 px."""


@dataclass(frozen=True, slots=True)
class Directions:
    """Pan and tilt of each frame, radians, and how the camera sits on the stage."""

    angles: list[tuple[float, float]]
    mount: Mount


def directions(tree: TransformTree, frame: str, stamps: Sequence[int], findings: Findings) -> Directions:
    """Pan and tilt whose turns the transforms of an optical frame are.

    The axes are those of the tree's root (REP 103: z up), the roll of the first frame goes into the mount.
    Without transforms all angles are zero. What is no turn of a pan-tilt stage is noted.
    """
    if frame not in tree:
        findings.note(
            "no transform tells where the camera looked: the frames are registered by what they show"
        )
        return Directions([(0.0, 0.0)] * len(stamps), Mount())
    from scipy.spatial.transform import Rotation

    poses = [tree.pose(frame, stamp) for stamp in stamps]
    turns = [RIG_FROM_STAGE.T @ rotation for rotation, _ in poses]
    residual = _turn_back(turns[0]) @ turns[0]
    mount = Mount(rotation=tuple(Rotation.from_matrix(residual).as_rotvec().tolist()))
    platform = [turn @ residual.T for turn in turns]
    angles = [_pan_tilt(turn) for turn in platform]
    left = [turn.T @ stage_rotation(*place) for turn, place in zip(platform, angles, strict=True)]
    roll = max(float(np.linalg.norm(Rotation.from_matrix(rest).as_rotvec())) for rest in left)
    moved = max(float(np.linalg.norm(place - poses[0][1])) for _, place in poses)
    if roll > _ROLLED:
        findings.note(
            f"the transforms roll the camera by up to {np.degrees(roll):.2f}°, which pan and tilt cannot "
            "say: keep fusion.register_poses = true"
        )
    if moved > _MOVED:
        findings.note(
            f"the transforms move the camera by up to {moved:.3f} m; frames are fused as if it only turned: "
            "near things shift against far ones"
        )
    return Directions(angles, mount)


def _pan_tilt(turn: NDArray[np.float64]) -> tuple[float, float]:
    """Angles of the stage whose forward direction is that of `turn`."""
    x, y, z = turn[:, 2]
    return float(np.arctan2(-x, z)), float(np.arctan2(-y, np.hypot(x, z)))


def _turn_back(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    return stage_rotation(*_pan_tilt(turn)).T
