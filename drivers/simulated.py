"""A simulated camera and the simulated stage that turns it: stand-ins for the real ones, physics included."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, NoiseLaw, sr3000_calibration
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import DeviceTimeoutError, InitialisationError
from drivers.frame import Frame
from drivers.position import Position
from drivers.settings import CameraSettings, Capabilities
from drivers.simulation.options import CameraOptions, scene_of, true_calibration
from drivers.simulation.render import Renderer, Truth
from drivers.simulation.scene import Scene, Surface
from drivers.simulation.sensor import (
    GAIN,
    PHASE_NOISE,
    expose,
    noise_coefficient,
    phase_noise,
    with_errors,
)
from drivers.simulation.stage import SimulatedStage

__all__ = ["SimulatedCamera", "SimulatedStage"]

SAMPLES = 4
"""Phase samples of a frame, one after the other."""


class SimulatedCamera(Camera):
    """An SR3000 before a simulated scene, in the time of its clock.

    It runs freely from `start` on: frame n is exposed in the n-th frame period, whoever looks. `grab` gives
    the latest complete frame that was not yet delivered, else waits for the next one; frames that nobody took
    in time are gaps in `sequence`. After a movement the first frame may therefore be a stale one, as with a
    real camera. It sees the world turn with the stage it is mounted on, each of the four phase samples from
    the pose at the middle of that sample.

    A frame is computed while it is exposed, for where the stage is expected to point, so that whoever grabs
    waits as long as for a real camera; anew only where something else moved the stage meanwhile. By how much
    computing made a frame late is not held against whoever fetches the next ones, a period less each time.
    """

    Options = CameraOptions
    options: CameraOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._true = true_calibration(self.options)
        self._renderer: Renderer | None = None
        self._epoch = self._first = self._next = self._late = 0

    def truth(self, upsampling: int = 4, position: Position | None = None) -> Truth:
        """The noise-free view at `position` (the stage at rest at (0, 0) by default), β times as fine.

        Raises:
            StateError: the camera is closed.
        """
        return self.truth_renderer(upsampling, position)()

    def truth_renderer(self, upsampling: int = 4, position: Position | None = None) -> Callable[[], Truth]:
        """What renders the `truth` when it is called, by any thread, whatever becomes of the camera.

        Raises:
            StateError: the camera is closed.
        """
        self._require_open("ask the truth of")
        gain = GAIN * self._settings.integration_time
        return partial(self._rendering().truth, position or Position(0.0, 0.0), upsampling, gain)

    def _open(self) -> None:
        self._check_rate(self._settings)
        self._renderer = Renderer(scene_of(self.options), self._true)
        self._first = self._next = 0

    def _close(self) -> None:
        self._renderer = None

    def _start(self) -> None:
        self._restart()

    def _stop(self) -> None:
        pass

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        self._check_rate(settings)
        self._settings = settings
        if self.is_started:
            self._restart()
        return settings

    def _grab(self, timeout: float) -> Frame:
        period, now = self._period(self._settings), self.clock.now()
        complete = self._first + (now - self._late - self._epoch) // period
        number = max(self._next, complete - 1)
        ready = self._epoch + (number + 1 - self._first) * period
        wait = (ready - now) / 1e9
        if wait > timeout:
            self.clock.sleep(timeout)
            raise DeviceTimeoutError(
                f"no frame within {timeout:.3f} s: one takes {period / 1e9:.3f} s with these settings"
            )
        start = ready - self._exposure(self._settings)
        expected = self._poses(start)
        images = self._expose(expected, number)
        self._late = max(self.clock.now() - max(now, ready), self._late - period, 0)
        self.clock.sleep((ready - self.clock.now()) / 1e9)
        self._next = number + 1
        if (poses := self._poses(start)) != expected:
            began = self.clock.now()
            images = self._expose(poses, number)
            self._late += self.clock.now() - began
        return self._frame(number, start, *images)

    @property
    def true_calibration(self) -> Calibration:
        """What the camera really is, which `calibration` need not say."""
        if self.options.calibration is not None or not self.options.noise:
            return self._true
        coefficient = noise_coefficient(self._settings.ambiguity_range)
        return self._true.model_copy(update={"noise": NoiseLaw(coefficient=coefficient)})

    def show(self, surfaces: Sequence[Surface]) -> None:
        """Put another scene before the camera, surfaces in stage axes.

        Raises:
            StateError: the camera is closed.
        """
        self._require_open("show anything to")
        self._renderer = Renderer(Scene(self.options.scene, surfaces), self._true)

    def _calibration(self) -> Calibration:
        return self.true_calibration if self.options.calibrated else sr3000_calibration()

    def _capabilities(self) -> Capabilities:
        return Capabilities(
            shape=sr3000_calibration().shape,
            source="simulation",
            carries_pose=False,
            model=f"simulated SR3000, scene {self.options.scene}",
        )

    def _frame(
        self, number: int, start: int, counts: NDArray[np.uint16], amplitude: NDArray[np.uint16]
    ) -> Frame:
        settings, exposure = self._settings, self._exposure(self._settings)
        reported = self._stage.position if self._stage is not None and self._stage.is_open else None
        return Frame(
            counts=counts,
            amplitude=amplitude,
            timestamp=start + exposure // 2,
            sequence=number,
            pan=reported.pan if reported else 0.0,
            tilt=reported.tilt if reported else 0.0,
            integration_time=settings.integration_time,
            modulation_frequency=settings.modulation_frequency,
            ambiguity_range=settings.ambiguity_range,
            amplitude_mode=settings.amplitude_mode,
        )

    def _expose(self, poses: list[Position], number: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        received = self._rendering().correlations(poses, self._settings.ambiguity_range)
        noise = np.random.default_rng([self.options.seed, number]) if self.options.noise else None
        span, law = self._settings.ambiguity_range, self._true.noise
        strength = PHASE_NOISE if law is None else phase_noise(law.coefficient, span)
        counts, amplitude = expose(received, self._settings, noise, strength)
        errors = self._true.corrections
        return (with_errors(counts, errors, span) if errors else counts), amplitude

    def _poses(self, start: int) -> list[Position]:
        """Where the stage points in the middle of each sample of an exposure that begins at `start`."""
        stage, exposure = self._stage, self._exposure(self._settings)
        if isinstance(stage, SimulatedStage):
            return [stage.pose_at(start + exposure * (2 * k + 1) // (2 * SAMPLES)) for k in range(SAMPLES)]
        if stage is not None and stage.is_open and not stage.needs_home:
            return [stage.position] * SAMPLES
        return [Position(0.0, 0.0)] * SAMPLES

    def _rendering(self) -> Renderer:
        assert self._renderer is not None
        return self._renderer

    def _restart(self) -> None:
        # Rendered and compiled before time begins to count, so that the first frame is not late.
        self._expose(self._poses(self.clock.now()), self._next)
        self._epoch, self._first, self._late = self.clock.now(), self._next, 0

    def _exposure(self, settings: CameraSettings) -> int:
        return round((SAMPLES * settings.integration_time + self.options.readout) * 1e9)

    def _longest_exposure(self, integration_time: float | None) -> float:
        return super()._longest_exposure(integration_time) + self.options.readout

    def _period(self, settings: CameraSettings) -> int:
        return self._exposure(settings) if settings.frame_rate is None else round(1e9 / settings.frame_rate)

    def _check_rate(self, settings: CameraSettings) -> None:
        rate, exposure = settings.frame_rate, self._exposure(settings)
        # A nanosecond of rounding is not an impossible rate.
        if rate is not None and self._period(settings) < exposure - 1:
            longest = (1 / rate - self.options.readout) / SAMPLES
            advice = (
                f"or integrate for at most {1e3 * longest:.2f} ms" if longest > 0 else "which is the most"
            )
            raise InitialisationError(
                f"{rate:g} frames/s are impossible with an integration time of "
                f"{1e3 * settings.integration_time:g} ms: a frame takes four of them and "
                f"{1e3 * self.options.readout:g} ms of readout, {exposure / 1e6:.2f} ms in all; "
                f"ask for at most {1e9 / exposure:.2f} frames/s {advice}"
            )
