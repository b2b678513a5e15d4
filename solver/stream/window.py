"""The latest frames of a stream on one grid, and the problem that they make."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.geometry.poses import Pose, PoseSpace, overlap
from solver.options import FusionOptions
from solver.preparation.prepare import exchange, prepare
from solver.preparation.problem import Problem
from solver.stream.change import Basis, Look

_MANY = 8
"""Frames of which one is a small part."""

_ROUNDS = 2
"""How often all frames are exchanged before the problem is prepared anew: more seldom costs accuracy, more
often maps per second."""

_PART = 3
"""After a change the window is prepared anew when one in so many of its frames has been exchanged: more
seldom shows the change late, more often costs time."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One frame; its pose is relative to the first frame of the stream, `relative` to the grid's."""

    number: int
    distance: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    pose: Pose
    relative: Pose
    positions: NDArray[np.float32]
    look: Look


class Window:
    """The last `size` frames.

    The problem of a full window, unless its frames are few, changes frame by frame. Now and then it is
    prepared anew: noise, λ and what else belongs to all frames follow the scene that slowly, and sums that
    frames are added to and taken from do not gather rounding errors. So it is every third of a window while
    frames of before and after a change are mixed, and once more when those of before are gone: what was
    learned of the former scene, and a map that came from there, would hold out for long.

    Attributes:
        grid: pose of the frame on whose grid positions are.
        entries: oldest first.
    """

    def __init__(self, size: int, space: PoseSpace) -> None:
        self._size, self._space = size, space
        self.entries: deque[Entry] = deque(maxlen=size)
        self.grid = space.origin()
        self._since_change, self._changed = size + 1, False
        self.renew()

    def clear(self) -> None:
        """Forget every frame."""
        self.entries.clear()
        self._since_change = self._size + 1
        self.renew()

    def renew(self) -> None:
        """Have the next problem prepared anew."""
        self._problem: Problem | None = None
        self._basis: Basis | None = None
        self._exchanges = 0

    def add(
        self,
        number: int,
        distance: NDArray[np.float32],
        amplitude: NDArray[np.float32] | None,
        pose: Pose,
        look: Look,
    ) -> bool:
        """Add a frame (H, W), for which a full window gives up its oldest; whether the grid moved to it."""
        if not self.entries:
            self.grid = pose
        entry = self._entry(number, distance, amplitude, pose, look)
        moved = overlap(entry.positions) < 0.5
        if moved:
            self.grid = pose
            entry = self._entry(number, distance, amplitude, pose, look)
            kept = [self._entry(e.number, e.distance, e.amplitude, e.pose, e.look) for e in self.entries]
            self.clear()
            self.entries.extend(kept)
        full = len(self.entries) == self._size >= _MANY
        self.entries.append(entry)
        self._changed = False
        if not (full and self._exchanged(entry)):
            self.renew()
        elif self._outdated():
            self.renew()
            self._changed = True
        return moved

    def _entry(
        self,
        number: int,
        distance: NDArray[np.float32],
        amplitude: NDArray[np.float32] | None,
        pose: Pose,
        look: Look,
    ) -> Entry:
        relative = self._space.relative(pose, self.grid)
        positions = self._space.positions(distance.shape, relative)
        return Entry(number, distance, amplitude, pose, relative, positions, look)

    def _exchanged(self, entry: Entry) -> bool:
        """Whether the frame could take the oldest one's place in the problem."""
        if self._problem is None or self._basis is None or self._exchanges == _ROUNDS * self._size:
            return False
        slot = self._exchanges % self._size
        self._exchanges += 1
        sampled = exchange(self._problem, slot, entry.distance, entry.amplitude, entry.positions)
        suits = self._basis.suits(self._problem, entry.look)
        self._since_change = self._since_change + 1 if suits else 0
        return sampled

    def _outdated(self) -> bool:
        """Whether frames of before a change are gone, or have long been mixed with those of after it."""
        mixed = self._since_change < self._size
        return self._since_change == self._size or (mixed and self._exchanges >= self._size // _PART)

    def problem(self, options: FusionOptions, ambiguity_range: float | None) -> Problem:
        """That of all frames; the one before with one frame exchanged, where it could be kept.

        Raises:
            FusionInputError: no sample is left.
        """
        if self._problem is None:
            lights = [entry.amplitude for entry in self.entries if entry.amplitude is not None]
            self._problem = prepare(
                np.stack([entry.distance for entry in self.entries]),
                np.stack(lights) if lights else None,
                np.stack([entry.positions for entry in self.entries]),
                options=options,
                ambiguity_range=ambiguity_range,
                noise=self._noise(),
            )
            self._problem.changed = self._changed
            if len(self.entries) == self._size >= _MANY:
                self._basis = Basis.of(self._problem, [entry.look for entry in self.entries])
                # What changed just now, or while the window filled, is no event of a frame to come.
                if self._basis.mixed and self._since_change > self._size:
                    self._since_change = 0
        return self._problem

    def _noise(self) -> float:
        """The median of the frames', but for those that tell of none."""
        known = [entry.look.noise for entry in self.entries if entry.look.noise > 0]
        return float(np.median(known)) if known else 0.0
