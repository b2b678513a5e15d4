"""Where the next frame of a stream looks."""

from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.geometry.poses import Pose, PoseSpace, overlap
from solver.preparation.farthest import measured
from solver.stream.window import Window

_FEW = 6
"""Frames at least that a mosaic is made of: one of fewer is aliased, and what it misplaces would stay."""

_TOGETHER = 15
"""Frames at most that are registered together with every new one, and all their poses set right by it: what
looks alike in two places is told apart by many frames, in a fifth of a second for all of them."""

_USUAL = 15
"""Frames that the mosaic is made of where the window holds few."""

_NEAR = 0.8
"""Overlap with the first frame down to which a search for the others, a quarter of the image far, is safe."""

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
    with the one before it alone, the errors would sum up. The first ones are registered together, as by
    `fuse`, and placed anew with each that comes.

    Args:
        size: how many frames the window holds.
        space: of the poses.
        ambiguity_range: as for `fuse`.

    Attributes:
        period: pixels after which all that is seen repeats, so that only a guess tells where a frame looks
            that is half of that away from the one before; None = it does not.
    """

    def __init__(self, size: int, space: PoseSpace, ambiguity_range: float | None) -> None:
        self._space, self._range = space, ambiguity_range
        self._horizon = size if size >= _FEW else _USUAL
        self._before: deque[_Placed] = deque(maxlen=max(size, _FEW))
        self.forget()

    def forget(self) -> None:
        """Make the mosaic anew: the window has another grid, or frames that were not followed."""
        self._track: Track | None = None
        self._before.clear()
        self._fixed, self._guessed = 0, False
        self.period: float | None = None

    def pose(
        self,
        window: Window,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        """The pose of a frame (H, W) with its amplitude, near the newest one's unless there is a guess.

        Of the frame nothing is too far to be measured.

        Raises:
            RegistrationError: it does not fit.
        """
        if not self._before:
            self._before.extend(
                _Placed(measured(one.distance, self._range), one.amplitude, one.pose)
                for one in window.entries
            )
            self._fixed = len(self._before)
        self._guessed |= guess is not None
        if len(self._before) < min(self._before.maxlen or 0, _TOGETHER):
            found = self._placed_anew(window, frame, light, guess)
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
            positions = [self._space.relative(one.pose, grid) for one in self._before]
            track.begin(*self._stacked(), positions)
            self._track, self.period = track, track.period
        near = self._before[-1].pose if guess is None else guess
        place = self._space.relative(near, grid)
        found = self._track.follow(frame, light, place, guided=guess is not None)
        return self._space.composed(grid, found)

    def _placed_anew(
        self,
        window: Window,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        """Of a frame that fits a mosaic of those before, where all are registered together."""
        if len(self._before) < _FEW:
            found = self._together(frame, light, guess)
        else:
            found = self._followed(window.grid, frame, light, guess)
            self._track = None  # its frames get other places
            with suppress(RegistrationError):  # against the first frame alone it may not be found
                found = self._together(frame, light, found)
        self._place(window)
        return found

    def _together(
        self,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> Pose:
        from solver.registration import register

        base = self._before[0].pose
        poses = [self._space.relative(one.pose, base) for one in self._before]
        poses.append(poses[-1] if guess is None else self._space.relative(guess, base))
        distances, lights = self._stacked()
        found = register(
            np.concatenate([distances, frame[None]]),
            None if lights is None or light is None else np.concatenate([lights, light[None]]),
            intrinsics=self._space.matrix,
            distortion=self._space.distortion,
            initial=np.stack(poses) if self._guessed or self._far(frame.shape, poses) else None,
            ambiguity_range=self._range,
        )
        new = len(self._before)
        if new in found.rejected:
            raise RegistrationError(found.rejected[new])
        moved = found.shifts if found.rotations is None else found.rotations
        for k in range(self._fixed, new):
            if k not in found.rejected:
                self._before[k] = self._before[k]._replace(pose=self._space.composed(base, moved[k]))
        self.period = found.period
        return self._space.composed(base, moved[new])

    def _far(self, shape: tuple[int, ...], poses: list[Pose]) -> bool:
        """Whether frames look too far from the first one to be looked for around it."""
        return any(overlap(self._space.positions(shape, pose)) < _NEAR for pose in poses)

    def _stacked(self) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Distances and amplitudes (N, H, W) of the frames before."""
        lights = [one.amplitude for one in self._before if one.amplitude is not None]
        return np.stack([one.distance for one in self._before]), np.stack(lights) if lights else None

    def _place(self, window: Window) -> None:
        """Place the frames of the window where they are found to look by now."""
        first = len(self._before) - len(window.entries)
        for k, entry in enumerate(window.entries):
            pose = self._before[first + k].pose
            relative = self._space.relative(pose, window.grid)
            positions = self._space.positions(entry.distance.shape, relative)
            window.entries[k] = replace(entry, pose=pose, relative=relative, positions=positions)
        window.renew()
