"""How far a fused map is from the truth, where there is one, beside what a single frame would give."""

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from service.messages.map import FusedMap


class Errors(BaseModel):
    """Distance errors against the truth, metres, beside those of one frame.

    Over the pixels that truth, map and single frame all know.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    rms: float = Field(ge=0)
    mean_absolute: float = Field(ge=0)
    nearest_rms: float = Field(ge=0, description="Of the reference frame, each pixel repeated β × β times.")
    nearest_mean_absolute: float = Field(ge=0)
    pixels: int = Field(ge=1, description="Pixels compared: those that truth, map and frame all know.")


def error_map(result: FusedMap, truth: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """(βH, βW) fused minus true distance, metres; None without a truth of the map's size."""
    if truth is None or truth.shape != result.distance.shape:
        return None
    return result.distance - truth


def judge(result: FusedMap, truth: NDArray[np.float32] | None) -> Errors | None:
    """Compare a map with the truth (βH, βW), metres; None without a truth of the map's size."""
    error = error_map(result, truth)
    if error is None or truth is None:
        return None
    frame = result.calibration.correct(result.frame.distance, result.frame.ambiguity_range)
    factor = result.report.upsampling
    single = frame.repeat(factor, axis=0).repeat(factor, axis=1) - truth
    both = np.isfinite(error) & np.isfinite(single)
    pixels = np.count_nonzero(both)
    if pixels == 0:
        return None
    (rms, mean), (nearest_rms, nearest_mean) = (_means(error, both), _means(single, both))
    return Errors(
        rms=rms,
        mean_absolute=mean,
        nearest_rms=nearest_rms,
        nearest_mean_absolute=nearest_mean,
        pixels=pixels,
    )


def _means(error: NDArray[np.float32], known: NDArray[np.bool_]) -> tuple[float, float]:
    """Root mean square, and mean absolute, of what is known."""
    size = np.abs(error if known.all() else error[known])
    return float(np.sqrt(np.mean(np.square(size), dtype=np.float64))), float(np.mean(size, dtype=np.float64))
