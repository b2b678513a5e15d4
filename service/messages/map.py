"""The fused map: what a fusion gives, and where it belongs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.frame import Frame
from service.messages.report import BurstReport


@dataclass(frozen=True, slots=True)
class FusedMap:
    """A fused map.

    Attributes:
        frame: the reference frame: its angles are the map's. In a stream it bears the time and number of the
            newest frame.
        calibration: of the camera (one frame).
        distance: (βH, βW) float32, radial metres, NaN = unknown.
        depth: (βH, βW) float32, Z in metres.
        deviation: (βH, βW) float32, one standard deviation of the distance, metres.
        amplitude: (βH, βW) float32, counts per second of integration time, or None.
        reason: (βH, βW) uint8, why a pixel has this distance or none; see `solver.completion.reason`.
        intrinsics: (3, 3) camera matrix of the map, pixels; the distortion is the calibration's.
        report: how it went.
    """

    frame: Frame
    calibration: Calibration
    distance: NDArray[np.float32]
    depth: NDArray[np.float32]
    deviation: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    reason: NDArray[np.uint8]
    intrinsics: NDArray[np.float64]
    report: BurstReport

    @property
    def size(self) -> int:
        """Bytes of its images."""
        images = (self.distance, self.depth, self.deviation, self.amplitude, self.reason)
        return sum(image.nbytes for image in images if image is not None)
