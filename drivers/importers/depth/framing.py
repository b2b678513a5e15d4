"""Frames of depth images, however they come."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.depth.reading import Ranging, amplitude_counts, saturation_level
from drivers.errors import RecordingError
from drivers.frame import Frame, ambiguity_range
from drivers.importers.exposure import ImportOptions, Source

MANY = 200
"""Frames that no burst should have more of: the most that are fused at once."""


@dataclass(frozen=True, slots=True)
class Image:
    """Pixels of a frame's images: depth, and amplitude or None."""

    depth: NDArray[Any]
    amplitude: NDArray[Any] | None


class Framing:
    """Makes frames, one after the other.

    Args:
        calibration: of the camera.
        options: how values are read, and what else is known of the camera.
        frames_per_burst: None = all are one burst.

    Raises:
        RecordingError: it is not told whether images hold depth or distance.
    """

    def __init__(
        self, calibration: Calibration, options: ImportOptions, frames_per_burst: int | None
    ) -> None:
        self._ranging = Ranging(options.reading, calibration)
        self._options, self._per_burst = options, frames_per_burst
        self._count = 0

    def frame(self, image: Image, timestamp: int, angles: tuple[float, float]) -> Frame:
        """The next frame; raises `RecordingError` where its images are not of the calibration's size."""
        counts, scale = self._ranging.counts(image.depth)
        amplitude = None if image.amplitude is None else amplitude_counts(image.amplitude)
        sequence, per_burst = self._count, self._per_burst
        burst, pose = divmod(sequence, per_burst) if per_burst else (0, sequence)
        if amplitude is not None and amplitude.shape != counts.shape:
            raise RecordingError(
                f"the amplitude image has {amplitude.shape[0]} × {amplitude.shape[1]} pixels, the depth "
                f"image {counts.shape[0]} × {counts.shape[1]}"
            )
        frequency = self._options.modulation_frequency
        frame = Frame(
            counts=counts,
            amplitude=amplitude,
            timestamp=timestamp,
            sequence=sequence,
            pan=angles[0],
            tilt=angles[1],
            integration_time=self._options.integration_time,
            modulation_frequency=frequency,
            ambiguity_range=None if frequency is None else ambiguity_range(frequency),
            amplitude_mode=self._options.amplitude_mode or "linear",
            saturation_level=saturation_level(image.amplitude),
            burst=burst,
            pose=pose,
            scale=scale,
        )
        self._count += 1
        return frame


def depth_source(model: str, calibration: Calibration, options: ImportOptions) -> Source:
    """Another maker's depth camera, of which no more is known than is told."""
    mode = options.amplitude_mode or "linear"
    return Source(model, None, calibration, options.modulation_frequency, mode)
