"""Whether a frame can be the one that the others are placed by."""

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.registration.samples import Samples, pyramid, scaling

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FEWEST = 0.05  # share of valid pixels under which a frame cannot be placed
_BLANK = 0.05  # of the other frames' contrast; frames of a twentieth of the light fit none of them anyhow
_NOTHING = 0.01  # deviations; a plain wall has those of its noise, about one where it is pooled most


def check_first(distance: Image, amplitude: Image | None, ambiguity_range: float | None) -> None:
    """Refuse a frame (H, W) that no later one could be placed by.

    Raises:
        RegistrationError: it has hardly a valid pixel, no light, or is the same everywhere.
    """
    frame, light = distance[None], None if amplitude is None else amplitude[None]
    levels = pyramid(scaling(frame, light, ambiguity_range)(frame, light))
    why = why_no_reference(levels, 0, np.zeros(1, dtype=np.bool_))
    if why:
        raise RegistrationError(
            f"nothing could be placed by this frame: {why}; begin with one that shows the scene or give poses"
        )


def why_too_few(weights: Image) -> str:
    """Why a frame of such weights cannot be placed; empty where enough of its pixels are valid."""
    share = (weights > 0).mean()
    if share >= _FEWEST:
        return ""
    return f"{100 * share:.1f} % of its pixels are valid; at least {100 * _FEWEST:.0f} % are needed"


def why_no_reference(levels: list[Samples], reference: int, others: Mask) -> str:
    """Why the other frames (N,) cannot be placed by the reference; empty where they can.

    A plain wall is no reason: no frame shows more of it, and all stay where they are guessed.
    """
    too_few = why_too_few(levels[0].weights[reference])
    if too_few:
        return too_few
    contrast = _contrast(levels[-1])
    told = contrast[others & np.isfinite(contrast)]
    least = _BLANK * float(np.median(told)) if told.size else _NOTHING
    if not contrast[reference] >= least:  # NaN, where too few pixels are left to tell
        return "it has no light, or is the same everywhere"
    return ""


def _contrast(samples: Samples) -> NDArray[np.float32]:
    """(N,): the range of each frame's values, without the outermost fiftieths, in deviations; NaN of none."""
    channels, count = samples.values.shape[:2]
    used = samples.weights > 0
    values = np.where(used, samples.values, np.nan).reshape(channels, count, -1)
    values.sort(axis=-1)  # NaN comes last
    last = np.maximum(np.count_nonzero(used, axis=(1, 2)) - 1, 0)
    low, high = (
        np.take_along_axis(values, np.rint(share * last).astype(int)[None, :, None], -1)[..., 0]
        for share in (0.02, 0.98)
    )
    return np.asarray(np.linalg.norm(high - low, axis=0), np.float32)
