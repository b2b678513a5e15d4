"""Where the next frame of a stream looks."""

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.geometry.poses import Pose, PoseSpace
from solver.stream.window import Window

_FEW = 6
"""Frames that are registered together: a mosaic of fewer is aliased, and what it misplaces would stay."""

_USUAL = 15
"""Frames that the mosaic is made of where the window holds few."""

if TYPE_CHECKING:
    from solver.registration import Track


class _Placed(NamedTuple):
    """A frame (H, W) with its amplitude, and its pose relative to the first frame of the stream."""

    distance: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    pose: Pose


class Follower:
    """Registers each frame against those before it, with the mosaic that it keeps of them.

    These are the frames of the window, or the last few where the window holds fewer: were each frame aligned
    with the one before it alone, the errors would sum up.

    Args:
        size: how many frames the window holds.
        space: of the poses.
        ambiguity_range: as for `fuse`.
    """

    def __init__(self, size: int, space: PoseSpace, ambiguity_range: float | None) -> None:
        self._space, self._range = space, ambiguity_range
        self._horizon = size if size >= _FEW else _USUAL
        self._before: deque[_Placed] = deque(maxlen=max(size, _FEW))
        self._track: Track | None = None

    def forget(self) -> None:
        """Make the mosaic anew: the window has another grid, or frames that were not followed."""
        self._track = None
        self._before.clear()

    def pose(
        self,
        window: Window,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        """The pose of a frame (H, W) with its amplitude, near the newest one's unless there is a guess.

        Raises:
            RegistrationError: it does not fit.
        """
        if not self._before:
            self._before.extend(_Placed(one.distance, one.amplitude, one.pose) for one in window.entries)
        if len(self._before) < _FEW:
            found = self._among_few(frame, light, guess)
        else:
            found = self._followed(window.grid, frame, light, guess)
        self._before.append(_Placed(frame, light, found))
        return found

    def _followed(
        self,
        grid: Pose,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        if self._track is None:
            from solver.registration import Track

            track = Track(self._horizon, self._space.matrix, self._space.distortion, self._range)
            for one in self._before:
                track.add(one.distance, one.amplitude, self._space.relative(one.pose, grid))
            self._track = track
        near = self._before[-1].pose if guess is None else guess
        return self._space.composed(grid, self._track.follow(frame, light, self._space.relative(near, grid)))

    def _among_few(
        self,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        from solver.registration import register

        base = self._before[0].pose
        poses = [self._space.relative(one.pose, base) for one in self._before]
        poses.append(poses[-1] if guess is None else self._space.relative(guess, base))
        lights = [one.amplitude for one in self._before if one.amplitude is not None]
        found = register(
            np.stack([*(one.distance for one in self._before), frame]),
            None if light is None else np.stack([*lights, light]),
            intrinsics=self._space.matrix,
            distortion=self._space.distortion,
            initial=np.stack(poses),
            ambiguity_range=self._range,
        )
        new = len(self._before)
        if new in found.rejected:
            raise RegistrationError(found.rejected[new])
        moved = (found.shifts if found.rotations is None else found.rotations)[-1]
        return self._space.composed(base, moved)
