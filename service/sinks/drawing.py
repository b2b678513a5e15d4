"""One picture per burst: what went in, what came out, and how good it is."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from service.files import whole_file
from service.messages.map import FusedMap
from service.messages.quality import Errors, error_map
from service.sinks.canvas import Panel, draw
from service.sinks.shading import Surface
from solver.completion.reason import CONTRADICTED, DARK, FILLED, OUTSIDE, SATURATED

_VIEWS = ((0.4, 0.15), (-0.4, 0.15))
"""Yaw and pitch of the two viewpoints, radians: far enough round to see relief, not to hide half of it."""

_SAMPLED = 176
"""Columns that percentiles are taken of."""

_UNKNOWN = {DARK: "dark", SATURATED: "saturated", CONTRADICTED: "contradicted", OUTSIDE: "outside"}
"""Names by reason."""


def write_preview(
    path: Path,
    result: FusedMap,
    truth: NDArray[np.float32] | None = None,
    errors: Errors | None = None,
) -> None:
    """Draw a map and save it as PNG, whole or not at all.

    Panels: distance and amplitude of the reference frame, fused depth with the reason where it is unknown,
    the surface from two sides, and the error where there is a truth of the map's size, else the standard
    deviation.

    Args:
        path: of the picture.
        result: the map.
        truth: (βH, βW) true distance, metres, or None.
        errors: of the map against it, for the title.

    Raises:
        OutputError: it cannot be written.
    """
    sheet = draw(panels_of(result, truth), title_of(result, errors))
    with whole_file(path) as partial:
        # Level 1 is a tenth larger than the default and takes a third of the time.
        sheet.save(partial, format="png", compress_level=1)


def panels_of(result: FusedMap, truth: NDArray[np.float32] | None) -> list[Panel]:
    """What is shown of a map."""
    frame, depth = result.frame, result.depth
    of = f"frame {frame.sequence}"
    size = f"{depth.shape[1]} × {depth.shape[0]}"
    surface = Surface(result.distance, result.intrinsics, result.calibration.distortion or None)
    return [
        Panel(frame.distance, "viridis", f"{of}: distance, m", *_range(frame.distance)),
        _amplitude(frame, of),
        Panel(
            depth,
            "viridis",
            f"fused depth, m, {size}, filled {np.mean(result.reason == FILLED):.1%}",
            *_range(depth),
            marks=_marks(result.reason),
            names=_names(result.reason),
        ),
        *(_side(surface, yaw, pitch) for yaw, pitch in _VIEWS),
        _judged(result, truth),
    ]


def _amplitude(frame: Frame, of: str) -> Panel:
    if frame.amplitude is None:
        nothing = np.full(frame.shape, np.nan)
        return Panel(nothing, "grey", f"{of}: the camera gives no amplitude", 0.0, 1.0, scale=False)
    brightest = max(1.0, float(frame.amplitude.max()))
    return Panel(frame.amplitude, "grey", f"{of}: amplitude, counts", 0.0, brightest, root=True)


def _side(surface: Surface, yaw: float, pitch: float) -> Panel:
    side = f"{abs(np.degrees(yaw)):.0f}° from the {'right' if yaw > 0 else 'left'}"
    seen = surface.seen_from(yaw, pitch)
    return Panel(seen, "grey", f"surface, seen {side}", 0.0, 1.0, scale=False, dark=True)


def _judged(result: FusedMap, truth: NDArray[np.float32] | None) -> Panel:
    error = error_map(result, truth)
    if error is None:
        spread = result.deviation * 1000
        # Where hardly anything came back it is many times what it is elsewhere, and would hide all the rest.
        known = _sample(spread)
        limit = float(np.percentile(known, 90)) if known.size else 1.0
        return Panel(spread, "magma", "standard deviation, mm", 0.0, max(limit, 1e-3))
    known = np.abs(_sample(error)) * 1000
    limit = max(1.0, float(np.percentile(known, 95))) if known.size else 1.0
    return Panel(error * 1000, "red-blue", "error, fused − true distance, mm", -limit, limit)


def _marks(reason: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Which mark stands for each pixel that is unknown, from 1; 0 = known."""
    numbers = np.zeros(max(_UNKNOWN) + 1, np.uint8)
    for mark, value in enumerate(_UNKNOWN, 1):
        numbers[value] = mark
    return np.asarray(numbers[reason])


def _names(reason: NDArray[np.uint8]) -> tuple[str, ...]:
    """Why pixels are unknown, each with what part of the map it is."""
    shares = {name: float(np.mean(reason == value)) for value, name in _UNKNOWN.items()}
    return tuple(f"{name} {share:.1%}" if share else name for name, share in shares.items())


def _range(image: NDArray[np.floating]) -> tuple[float, float]:
    """What to show of an image: all but the outermost percent at each end, which noise would take up."""
    known = _sample(image)
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, (1, 99))
    return float(low), float(max(high, low + 1e-3))


def _sample(image: NDArray[np.floating]) -> NDArray[np.floating]:
    """Known values of an image: all, or as many as the end of a scale needs."""
    step = max(1, image.shape[1] // _SAMPLED)
    values = image[::step, ::step]
    known: NDArray[np.floating] = values[np.isfinite(values)]
    return known


def title_of(result: FusedMap, errors: Errors | None) -> str:
    """What was fused how, and how well."""
    report = result.report
    said = [f"burst {report.burst}", f"{len(report.used)} of {report.frames} frames", report.method]
    if report.regularization is not None:
        said.append(f"λ = {report.regularization:.3g}")
    if errors is not None:
        said.append(
            f"RMS error {errors.rms * 1000:.1f} mm, mean {errors.mean_absolute * 1000:.1f} mm "
            f"(one frame: {errors.nearest_rms * 1000:.1f} mm, {errors.nearest_mean_absolute * 1000:.1f} mm)"
        )
    elif report.deviation is not None:
        said.append(f"median deviation {report.deviation * 1000:.1f} mm")
    return "   ·   ".join(said)
