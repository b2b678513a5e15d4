"""Streaming: a window of the last N frames, fused anew with every frame from where it was."""

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver import checks
from solver import noise as noise_law
from solver.errors import FusionInputError, RegistrationError
from solver.fusion import resolve, warn_unconverged
from solver.methods import load
from solver.options import FusionOptions
from solver.poses import Pose, PoseSpace, central
from solver.preparation import complete
from solver.problem import Solution
from solver.result import Fused, Report, Seconds
from solver.threads import enough_threads
from solver.window import Window

_LOST = 5
"""Frames in a row that do not fit, after which the scene is taken for another one."""

_FEW = 6
"""Frames that are registered together: a mosaic of fewer is aliased, and what it misplaces would stay."""

if TYPE_CHECKING:
    from solver.registration import Track


class SlidingFusion:
    """Fuses the last `window` frames on the grid of the first one.

    Positions are relative to the first frame pushed, which fixes the grid until `reset` or until the
    newest frame overlaps it by less than half; then the grid moves to the newest frame and the notes of
    the report say so. A map that starts from the one before is not certified: its report has no gap.

    Args:
        options: as for `fuse`.
        window: N, how many frames are fused; fewer are fused as they are.
        ambiguity_range, intrinsics, distortion, noise: as for `fuse`.

    Raises:
        FusionInputError: an argument cannot be used; the message says why.
    """

    def __init__(
        self,
        options: FusionOptions | None = None,
        window: int = 15,
        ambiguity_range: float | None = None,
        intrinsics: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        noise: float | None = None,
    ) -> None:
        self._options = options or FusionOptions()
        checks.check_options(self._options)
        if isinstance(window, bool) or not isinstance(window, (int, np.integer)) or window < 1:
            raise FusionInputError(f"window is {window!r}; expected a whole number of frames from 1 up")
        self._range = checks.check_scalar("ambiguity_range", ambiguity_range)
        self._matrix, self._lens = checks.check_intrinsics(intrinsics, distortion)
        self._space = PoseSpace(self._matrix, self._lens)
        self._noise = checks.check_scalar("noise", noise)
        self._size = int(window)
        self.reset()

    def reset(self) -> None:
        """Forget every frame; the next one pushed fixes the grid."""
        self._window = Window(self._size, self._space)
        self._pushed, self._misfits = 0, 0
        self._last: Solution | None = None
        self._track: Track | None = None

    def push(
        self,
        distance: ArrayLike,
        amplitude: ArrayLike | None = None,
        shift: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        initial: ArrayLike | None = None,
    ) -> Fused:
        """Add a frame (H, W) and fuse the window.

        Args:
            distance, amplitude: one frame, as for `fuse`; all frames with amplitude or all without.
            shift: exact (dy, dx), for a camera without intrinsics.
            rotation: exact rotation vector, for one with intrinsics.
            initial: a first guess of the same.

        Raises:
            FusionInputError: an argument cannot be used, or does not go with the frames before.
            RegistrationError: the frame fits none before it; the window is as it was. The fifth in a row
                starts the stream over instead, and the notes of the report say so.
        """
        begin = time.perf_counter()
        frame = checks.check_frames(np.asarray(distance)[None])[0]
        light = checks.check_amplitude(
            None if amplitude is None else np.asarray(amplitude)[None], (1, *frame.shape)
        )
        self._check_like(frame, light)
        options = replace(self._options, method=resolve(self._options.method, light, self._range))
        given = self._given(shift, rotation)
        guess = None
        if initial is not None:
            guess = checks.check_vectors("initial", np.asarray(initial)[None], 1, (len(self._window.grid),))
        with enough_threads(frame.size * options.upsampling**2):
            notes: tuple[str, ...] = ()
            if given is None:
                pose, notes = self._follow(frame, light, None if guess is None else guess[0])
            else:
                pose, self._track = given, None
            self._misfits = 0
            registered = time.perf_counter()
            notes += self._append(frame, None if light is None else light[0], pose)
            return self._fuse(options, notes, begin, registered)

    def _follow(
        self,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.float64], tuple[str, ...]]:
        """The pose of a frame, and notes; after a run of misfits the frames before are forgotten."""
        try:
            return self._register(frame, light, guess), ()
        except RegistrationError:
            self._misfits += 1
            if self._misfits < _LOST:
                raise
        self._window.clear()
        self._last, self._track = None, None
        why = f"the stream started over at frame {self._pushed}: {_LOST} frames in a row did not fit"
        return self._window.grid if guess is None else guess, (why,)

    def _check_like(self, frame: NDArray[np.float32], light: NDArray[np.float32] | None) -> None:
        if not self._window.entries:
            return
        first = self._window.entries[0]
        if frame.shape != first.distance.shape:
            raise FusionInputError(
                f"the frame has shape {frame.shape}; "
                f"expected that of the frames before, {first.distance.shape}"
            )
        if (light is None) != (first.amplitude is None):
            raise FusionInputError("give amplitude with every frame of a stream or with none")

    def _given(self, shift: ArrayLike | None, rotation: ArrayLike | None) -> NDArray[np.float64] | None:
        if shift is not None and rotation is not None:
            raise FusionInputError("shift and rotation are both given; expected at most one of them")
        name, value = ("shift", shift) if shift is not None else ("rotation", rotation)
        if value is None:
            return None
        wanted = "shift" if self._matrix is None else "rotation"
        if name != wanted:
            having = "without" if wanted == "shift" else "with"
            raise FusionInputError(f"{name} is given; a stream {having} intrinsics takes {wanted}")
        vector = checks.check_vectors(name, np.asarray(value)[None], 1, (len(self._window.grid),))
        return None if vector is None else vector[0]

    def _register(
        self,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: NDArray[np.float64] | None,
    ) -> NDArray[np.float64]:
        """The pose of a frame, which follows the track of the ones before."""
        if not self._window.entries:
            return np.zeros_like(self._window.grid)
        image = None if light is None else light[0]
        if len(self._window.entries) < _FEW:
            return self._among_few(frame, image, guess)
        from solver.registration import Track

        entries, grid = self._window.entries, self._window.grid
        if self._track is None:
            self._track = Track(self._size, self._matrix, self._lens, self._range)
            for entry in entries:
                self._track.add(entry.distance, entry.amplitude, entry.relative)
        first = entries[-1].relative if guess is None else self._space.relative(guess, grid)
        try:
            return self._space.composed(grid, self._track.follow(frame, image, first))
        except RegistrationError as error:
            raise RegistrationError(self._misfit(str(error))) from error

    def _among_few(
        self,
        frame: NDArray[np.float32],
        image: NDArray[np.float32] | None,
        guess: NDArray[np.float64] | None,
    ) -> NDArray[np.float64]:
        from solver.registration import register

        entries = list(self._window.entries)
        base = entries[0].pose
        poses = [self._space.relative(entry.pose, base) for entry in entries]
        poses.append(poses[-1] if guess is None else self._space.relative(guess, base))
        lights = [entry.amplitude for entry in entries if entry.amplitude is not None]
        found = register(
            np.stack([*(entry.distance for entry in entries), frame]),
            None if image is None else np.stack([*lights, image]),
            intrinsics=self._matrix,
            distortion=self._lens,
            initial=np.stack(poses),
            ambiguity_range=self._range,
        )
        if len(entries) in found.rejected:
            raise RegistrationError(self._misfit(found.rejected[len(entries)]))
        moved = (found.shifts if found.rotations is None else found.rotations)[-1]
        return self._space.composed(base, moved)

    def _misfit(self, why: str) -> str:
        return f"frame {self._pushed} does not fit the ones before: {why}"

    def _append(
        self, frame: NDArray[np.float32], light: NDArray[np.float32] | None, pose: Pose
    ) -> tuple[str, ...]:
        noise = self._noise
        if noise is None:
            noise = noise_law.estimate(frame[None], None if light is None else light[None], self._range)
        number = self._pushed
        self._pushed += 1
        if not self._window.add(number, frame, light, pose, noise):
            return ()
        self._last, self._track = None, None
        return (f"the grid moved to frame {number}: it overlapped the former one by less than half",)

    def _fuse(self, options: FusionOptions, notes: tuple[str, ...], begin: float, registered: float) -> Fused:
        try:
            problem = self._window.problem(options, self._range)
            solution = load(options.method)(problem, initial=self._last)
        except BaseException:
            self._window.renew()  # it may have got half-way
            raise
        self._last = solution
        distance, spread = complete(problem, solution)
        if not solution.converged and problem.exchanged is None:
            warn_unconverged(options, solution, stacklevel=4)
        entries = self._window.entries
        relative = np.stack([entry.relative for entry in entries])
        report = Report(
            method=options.method,
            regularization=solution.regularization,
            iterations=solution.iterations,
            objective=solution.objective,
            gap=None if solution.gap is None or np.isnan(solution.gap) else solution.gap,
            converged=solution.converged,
            seconds=Seconds(registered - begin, time.perf_counter() - registered),
            noise=problem.noise,
            used=tuple(entry.number for entry in entries),
            notes=notes,
        )
        if self._matrix is None:
            return Fused(distance, spread, solution.amplitude, relative, None, report)
        shifts = np.stack([central(entry.positions) for entry in entries])
        return Fused(distance, spread, solution.amplitude, shifts, relative, report)
