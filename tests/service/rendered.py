"""Frames of a simulated camera with any optics and errors, for calibration."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from drivers.calibration import Calibration
from drivers.frame import COUNTS_PER_RANGE, Frame
from drivers.position import Position
from drivers.settings import CameraSettings
from drivers.simulation.render import Renderer
from drivers.simulation.scene import Scene, Surface
from drivers.simulation.sensor import expose

SETTINGS = CameraSettings()
AHEAD = Position(0.0, 0.0)


class Studio:
    """A scene and a camera in it; the light is rendered once for each pose."""

    def __init__(self, surfaces: Sequence[Surface], calibration: Calibration, seed: int = 0) -> None:
        self._renderer = Renderer(Scene("studio", surfaces), calibration)
        self._noise = np.random.default_rng(seed)
        self._sequence = 0

    def frame(self, position: Position = AHEAD, settings: CameraSettings = SETTINGS) -> Frame:
        received = self._renderer.correlations([position] * 4, settings.ambiguity_range)
        counts, amplitude = expose(received, settings, self._noise)
        self._sequence += 1
        return Frame(
            counts=counts,
            amplitude=amplitude,
            timestamp=self._sequence * 10**8,
            sequence=self._sequence,
            pan=position.pan,
            tilt=position.tilt,
            integration_time=settings.integration_time,
            modulation_frequency=settings.modulation_frequency,
            ambiguity_range=settings.ambiguity_range,
        )


def with_error(frame: Frame, error: Callable[[np.ndarray], np.ndarray]) -> Frame:
    """The frame of a camera whose measured distance m is off by error(m)."""
    true = frame.distance.astype(np.float64)
    measured = true
    for _ in range(20):  # the error is given as a function of what is measured
        measured = true + error(measured)
    counts = np.rint(measured / frame.ambiguity_range * COUNTS_PER_RANGE)
    return replace(frame, counts=np.where(frame.valid, counts % COUNTS_PER_RANGE, 0).astype(np.uint16))
