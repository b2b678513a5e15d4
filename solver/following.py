"""Where the next frame of a stream looks."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.poses import Pose, PoseSpace
from solver.window import Window

_FEW = 6
"""Frames that are registered together: a mosaic of fewer is aliased, and what it misplaces would stay."""

if TYPE_CHECKING:
    from solver.registration import Track


class Follower:
    """Registers each frame against those of the window, with the mosaic that it keeps of them.

    Args:
        size: how many frames the window holds.
        space: of the poses.
        ambiguity_range: as for `fuse`.
    """

    def __init__(self, size: int, space: PoseSpace, ambiguity_range: float | None) -> None:
        self._size, self._space, self._range = size, space, ambiguity_range
        self._track: Track | None = None

    def forget(self) -> None:
        """Make the mosaic anew: the window has another grid, or frames that were not followed."""
        self._track = None

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
        if not window.entries:
            return np.zeros_like(window.grid)
        if len(window.entries) < _FEW:
            return self._among_few(window, frame, light, guess)
        if self._track is None:
            from solver.registration import Track

            track = Track(self._size, self._space.matrix, self._space.distortion, self._range)
            for entry in window.entries:
                track.add(entry.distance, entry.amplitude, entry.relative)
            self._track = track
        newest = window.entries[-1].relative
        first = newest if guess is None else self._space.relative(guess, window.grid)
        return self._space.composed(window.grid, self._track.follow(frame, light, first))

    def _among_few(
        self,
        window: Window,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        from solver.registration import register

        entries = list(window.entries)
        base = entries[0].pose
        poses = [self._space.relative(entry.pose, base) for entry in entries]
        poses.append(poses[-1] if guess is None else self._space.relative(guess, base))
        lights = [entry.amplitude for entry in entries if entry.amplitude is not None]
        found = register(
            np.stack([*(entry.distance for entry in entries), frame]),
            None if light is None else np.stack([*lights, light]),
            intrinsics=self._space.matrix,
            distortion=self._space.distortion,
            initial=np.stack(poses),
            ambiguity_range=self._range,
        )
        if len(entries) in found.rejected:
            raise RegistrationError(found.rejected[len(entries)])
        moved = (found.shifts if found.rotations is None else found.rotations)[-1]
        return self._space.composed(base, moved)
