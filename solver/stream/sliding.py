"""Streaming: a window of the last N frames, fused anew with every frame from where it was."""

import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver import checks
from solver.completion.complete import complete
from solver.errors import FusionInputError, RegistrationError
from solver.fusion import resolve, warn_unconverged
from solver.geometry.poses import Pose, PoseSpace, central
from solver.methods import load
from solver.options import FusionOptions
from solver.preparation import noise as noise_law
from solver.preparation.farthest import check_units, measured
from solver.preparation.problem import Solution
from solver.result import Fused, Report, Seconds
from solver.runtime.threads import enough_threads
from solver.stream.change import Look
from solver.stream.following import Follower
from solver.stream.window import Window

_LOST = 5
"""Frames in a row that do not fit, after which the scene is taken for another one."""


class SlidingFusion:
    """Fuses the last `window` frames on the grid of the first one.

    Positions are relative to the first frame pushed, which fixes the grid until `reset` or until the
    newest frame overlaps it by less than half; then the grid moves to the newest frame and the notes of
    the report say so. Those of the first frames, 15 at most, change as more come, unless given. A map that
    starts from the one before is not certified: its report has no gap.

    A full window of at least 8 frames is solved anew only now and then (see `stream.window`). Between, one
    frame is exchanged and a few iterations follow the data; `converged` says whether those were enough.

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
        self._follower = Follower(self._size, self._space, self._range)
        self._pushed, self._misfits = 0, 0
        self._last: Solution | None = None

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
            RegistrationError: the frame fits none before it, or is a first one that shows nothing to place
                others by; the window is as it was. The fifth in a row that fits none starts the stream over
                instead, and the notes of the report say so.
        """
        begin = time.perf_counter()
        # Copies: the window outlives the call, after which the caller may fill the same memory anew.
        frame = checks.check_frames(np.asarray(distance)[None])[0].copy()
        lights = checks.check_amplitude(
            None if amplitude is None else np.asarray(amplitude)[None], (1, *frame.shape)
        )
        light = None if lights is None else lights[0].copy()
        self._check_like(frame, light)
        check_units(frame[None], self._range)
        known = measured(frame, self._range)
        options = replace(self._options, method=resolve(self._options.method, light, self._range))
        given = self._given(shift, rotation)
        guess = None
        if initial is not None:
            guess = checks.check_vectors("initial", np.asarray(initial)[None], 1, (len(self._window.grid),))
        with enough_threads(frame.size * options.upsampling**2):
            try:
                notes: tuple[str, ...] = ()
                if given is None:
                    pose, notes = self._follow(known, light, None if guess is None else guess[0])
                else:
                    pose = given
                    self._follower.forget()
                self._misfits = 0
                registered = time.perf_counter()
                notes += self._append(frame, light, pose, self._look(known, light))
                return self._fuse(options, notes, begin, registered)
            except RegistrationError:
                raise
            except BaseException:
                self._window.renew()  # what was begun may have got half-way
                self._forget()
                raise

    def _forget(self) -> None:
        """Have the next map start anew, from the frames of the window alone."""
        self._last = None
        self._follower.forget()

    def _follow(
        self,
        frame: NDArray[np.float32],
        light: NDArray[np.float32] | None,
        guess: Pose | None,
    ) -> tuple[Pose, tuple[str, ...]]:
        """The pose of a frame, and notes; after a run of misfits the frames before are forgotten."""
        if not self._window.entries:
            self._check_first(frame, light)
            return np.zeros_like(self._window.grid), ()
        try:
            pose, period = self._follower.pose(self._window, frame, light, guess), self._follower.period
            if period is None or guess is not None:
                return pose, ()
            repeats = f"all that frame {self._pushed} shows repeats after {period:.0f} pixels: it is placed "
            return pose, (f"{repeats}within half of that from the one before; give `initial` otherwise",)
        except RegistrationError as error:
            self._misfits += 1
            if self._misfits < _LOST:
                why = f"frame {self._pushed} does not fit the ones before: {error}"
                raise RegistrationError(why) from error
        self._check_first(frame, light)
        self._window.clear()
        self._forget()
        why = f"the stream started over at frame {self._pushed}: {_LOST} frames in a row did not fit"
        return self._window.grid if guess is None else guess, (why,)

    def _check_first(self, frame: NDArray[np.float32], light: NDArray[np.float32] | None) -> None:
        from solver.registration import check_first

        check_first(frame, light, self._range)

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

    def _look(self, frame: NDArray[np.float32], light: NDArray[np.float32] | None) -> Look:
        lights, noise = None if light is None else light[None], self._noise
        if noise is None:
            noise = noise_law.estimate(frame[None], lights, self._range)
        return Look(0.0 if lights is None else noise_law.median_light(lights, frame[None]), noise)

    def _append(
        self, frame: NDArray[np.float32], light: NDArray[np.float32] | None, pose: Pose, look: Look
    ) -> tuple[str, ...]:
        number = self._pushed
        self._pushed += 1
        if not self._window.add(number, frame, light, pose, look):
            return ()
        self._forget()
        return (f"the grid moved to frame {number}: it overlapped the former one by less than half",)

    def _fuse(self, options: FusionOptions, notes: tuple[str, ...], begin: float, registered: float) -> Fused:
        problem = self._window.problem(options, self._range)
        solution = load(options.method)(problem, initial=self._last)
        self._last = solution
        distance, deviation, reason = complete(problem, solution)
        if not solution.converged and solution.iterations >= options.max_iterations:
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
            contradicted=problem.contradicted,
            notes=notes,
        )
        if self._matrix is None:
            return Fused(distance, deviation, solution.amplitude, relative, None, report, reason)
        shifts = np.stack([central(entry.positions) for entry in entries])
        return Fused(distance, deviation, solution.amplitude, shifts, relative, report, reason)
