"""One picture per burst: what went in, what came out, and how good it is."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.messages.map import FusedMap
from service.messages.quality import error_map, judge
from service.sinks.shading import shade

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VIEWS = ((0.4, 0.15), (-0.4, 0.15))
"""Yaw and pitch of the two viewpoints, radians: far enough round to see relief, not to hide half of it."""


def write_preview(path: Path, result: FusedMap, truth: NDArray[np.float32] | None = None) -> None:
    """Draw a burst and save it as PNG, whole or not at all.

    Panels: distance and amplitude of the reference frame, fused depth, the surface from two sides, and the
    error where there is a truth of the map's size, else the standard deviation.
    """
    figure = draw(result, truth)
    partial = path.with_name(path.name + ".partial")
    try:
        figure.savefig(partial, format="png", dpi=100)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def draw(result: FusedMap, truth: NDArray[np.float32] | None) -> "Figure":
    """The picture as a figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 8.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    frame, depth = result.frame, result.depth
    low, high = _range(depth)
    _image(
        axes[0, 0],
        frame.distance,
        "viridis",
        "distance, m",
        f"frame {frame.sequence}: distance",
        *_range(frame.distance),
    )
    _image(
        axes[0, 1],
        frame.amplitude,
        "gray",
        "amplitude, counts",
        f"frame {frame.sequence}: amplitude",
        root=True,
    )
    _image(
        axes[0, 2],
        depth,
        "viridis",
        "depth, m",
        f"fused depth, {depth.shape[1]} × {depth.shape[0]}",
        low,
        high,
    )
    for place, (yaw, pitch) in enumerate(_VIEWS):
        picture = shade(
            result.distance, result.intrinsics, result.calibration.distortion or None, yaw=yaw, pitch=pitch
        )
        side = f"{abs(np.degrees(yaw)):.0f}° from the {'right' if yaw > 0 else 'left'}"
        _image(axes[1, place], picture, "gray", None, f"surface, seen {side}", 0.0, 1.0, background="#20242c")
    _judged(axes[1, 2], result, truth)
    figure.suptitle(_title(result, truth), fontsize=12)
    return figure


def _judged(axes: "Axes", result: FusedMap, truth: NDArray[np.float32] | None) -> None:
    error = error_map(result, truth)
    if error is None:
        spread = result.deviation * 1000
        # Where hardly anything came back it is many times what it is elsewhere, and would hide all the rest.
        limit = float(np.nanpercentile(spread, 90)) if np.isfinite(spread).any() else 1.0
        _image(axes, spread, "magma", "standard deviation, mm", "deviation", 0.0, limit)
        return
    limit = (
        float(np.clip(np.nanpercentile(np.abs(error), 95) * 1000, 1.0, None))
        if np.isfinite(error).any()
        else 1.0
    )
    _image(
        axes, error * 1000, "RdBu_r", "fused − true distance, mm", "error against the truth", -limit, limit
    )


def _image(
    axes: "Axes",
    image: NDArray[np.floating] | NDArray[np.uint16],
    colours: str,
    unit: str | None,
    title: str,
    low: float | None = None,
    high: float | None = None,
    background: str = "#c8c8c8",
    root: bool = False,
) -> None:
    """Show an image; with `root`, brightness follows the square root, which light's wide range needs."""
    from matplotlib.colors import Normalize, PowerNorm

    axes.set_facecolor(background)
    scale = PowerNorm(0.5, vmin=low, vmax=high) if root else Normalize(low, high)
    shown = axes.imshow(image, cmap=colours, norm=scale, interpolation="nearest")
    axes.set_title(title, fontsize=11)
    axes.set_xticks([])
    axes.set_yticks([])
    if unit is not None:
        beyond = "neither" if low is None else "both"
        axes.figure.colorbar(shown, ax=axes, label=unit, shrink=0.85, extend=beyond)


def _range(image: NDArray[np.floating]) -> tuple[float, float]:
    """What to show of an image: all but the outermost percent at each end, which noise would take up."""
    known = image[np.isfinite(image)]
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, (1, 99))
    return float(low), float(max(high, low + 1e-3))


def _title(result: FusedMap, truth: NDArray[np.float32] | None) -> str:
    report = result.report
    said = [f"burst {report.burst}", f"{len(report.used)} of {report.frames} frames", report.method]
    if report.regularization is not None:
        said.append(f"λ = {report.regularization:.3g}")
    quality = judge(result, truth)
    if quality is not None:
        said.append(
            f"RMS error {quality.rms * 1000:.1f} mm, mean {quality.mean_absolute * 1000:.1f} mm "
            f"(one frame: {quality.nearest_rms * 1000:.1f} mm, {quality.nearest_mean_absolute * 1000:.1f} mm)"
        )
    elif report.deviation is not None:
        said.append(f"median deviation {report.deviation * 1000:.1f} mm")
    return "   ·   ".join(said)
