"""What the pixels of a depth image stand for, and their radial distances."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.lens import straightened

Kind = Literal["depth", "distance"]

MILLIMETRE = 1e-3
"""Of whole numbers; floating ones are metres (REP 118)."""

_LARGEST = 0xFFFF


class DepthReading(BaseModel):
    """How the values of a depth image are read."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Kind | None = Field(
        None, description="`depth` = Z, along the optical axis; `distance` = radial, along each pixel's ray."
    )
    scale: float | None = Field(
        None, ge=1e-9, le=1e3, description="Metres per unit; none = REP 118's, mm for integers, else metres."
    )
    invalid: tuple[float, ...] = Field(
        (), max_length=16, description="Values that mean no depth, besides 0, NaN and 65535."
    )


class Ranging:
    """Turns depth images of one camera into radial distances as `Frame.counts` has them.

    Args:
        reading: how values are read; its kind must be told.
        calibration: of the camera.

    Raises:
        RecordingError: the kind is not told.
    """

    def __init__(self, reading: DepthReading, calibration: Calibration) -> None:
        if reading.kind is None:
            raise RecordingError(
                "it is not told whether the images hold depth (Z, along the optical axis; ROS's REP 118) or "
                "distance (radial, along each pixel's ray): say which (--kind depth or --kind distance)"
            )
        self.reading, self._shape = reading, calibration.shape
        self._stretch = _ray_lengths(calibration) if reading.kind == "depth" else None

    def counts(self, pixels: NDArray[Any]) -> tuple[NDArray[np.uint16] | NDArray[np.float32], float | None]:
        """Radial distance and metres per count: uint16 as they were, else float32 metres.

        Args:
            pixels: (H, W), whole or floating numbers.

        Raises:
            RecordingError: an image of another size than the calibration's.
        """
        if pixels.shape != self._shape:
            raise RecordingError(
                f"the image has {_size(pixels.shape)} pixels, its calibration is for {_size(self._shape)}"
            )
        scale = self.reading.scale
        if scale is None:
            scale = MILLIMETRE if pixels.dtype.kind in "ui" else 1.0
        missing = self._missing(pixels)
        if self._stretch is None and pixels.dtype == np.uint16:
            return np.where(missing, np.uint16(0), pixels), scale
        metres = pixels.astype(np.float32)
        if scale != 1.0:
            metres *= np.float32(scale)
        if self._stretch is not None:
            metres *= self._stretch
        metres[missing] = np.nan
        return metres, None

    def _missing(self, pixels: NDArray[Any]) -> NDArray[np.bool_]:
        if pixels.dtype.kind == "f":
            missing = ~((pixels > 0) & (pixels < np.inf))
        elif pixels.dtype == np.uint16:
            missing = (pixels == 0) | (pixels == _LARGEST)
        else:
            missing = pixels <= 0
        for value in self.reading.invalid:
            missing |= pixels == value
        return missing


def amplitude_counts(pixels: NDArray[Any]) -> NDArray[np.uint16]:
    """(H, W) uint16 of an amplitude image; floating numbers are rounded.

    Raises:
        RecordingError: values that are no counts from 0 to 65535.
    """
    if pixels.dtype == np.uint16:
        return pixels
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint16)
    known = np.nan_to_num(pixels, nan=0.0, posinf=np.inf)
    if known.size and not (known.min() >= 0 and known.max() <= _LARGEST):
        raise RecordingError(
            f"an amplitude image with values from {known.min():g} to {known.max():g}; expected 0 to 65535"
        )
    counts: NDArray[np.uint16] = np.rint(known).astype(np.uint16)
    return counts


def saturation_level(pixels: NDArray[Any] | None) -> int:
    """The amplitude from which a pixel counts as saturated: the largest that the image's type holds."""
    return 0xFF if pixels is not None and pixels.dtype == np.uint8 else _LARGEST


def _ray_lengths(calibration: Calibration) -> NDArray[np.float32]:
    """(H, W) distance / depth of each pixel: √(1 + x² + y²) of its ray (x, y, 1)."""
    K = calibration.intrinsics
    rows, columns = np.mgrid[: calibration.height, : calibration.width].astype(np.float64)
    places = straightened(np.stack([columns, rows], axis=-1), calibration)
    x, y = (places[..., 0] - K.cx) / K.fx, (places[..., 1] - K.cy) / K.fy
    return np.sqrt(1 + x**2 + y**2).astype(np.float32)


def _size(shape: tuple[int, ...]) -> str:
    return " × ".join(map(str, shape))
