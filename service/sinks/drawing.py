"""One picture per burst: what went in, what came out, and how good it is."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from service.files import whole_file
from service.messages.map import FusedMap
from service.messages.quality import error_map, judge
from service.sinks.shading import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

_VIEWS = ((0.4, 0.15), (-0.4, 0.15))
"""Yaw and pitch of the two viewpoints, radians: far enough round to see relief, not to hide half of it."""


def write_preview(path: Path, result: FusedMap, truth: NDArray[np.float32] | None = None) -> None:
    """Draw a map and save it as PNG, whole or not at all; see `Picture`."""
    Picture(result, truth).save(path)


class Picture:
    """A picture of a map, which may be drawn again for the next one: laying it out takes longest.

    Panels: distance and amplitude of the reference frame, fused depth, the surface from two sides, and the
    error where there is a truth of the map's size, else the standard deviation.

    Args:
        result: the map.
        truth: (βH, βW) true distance, metres, or None.
    """

    def __init__(self, result: FusedMap, truth: NDArray[np.float32] | None) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.figure: Figure = Figure(figsize=(16, 8.6), layout="constrained")
        self._canvas = FigureCanvasAgg(self.figure)
        self._axes = self.figure.subplots(2, 3).ravel()
        self._shown: list[AxesImage] = []
        for axes, panel in zip(self._axes, _panels(result, truth), strict=True):
            self._shown.append(_show(axes, panel))
        self.figure.suptitle(_title(result, truth), fontsize=12)

    @staticmethod
    def kind(result: FusedMap, truth: NDArray[np.float32] | None) -> tuple[object, ...]:
        """Maps of one kind fit the same picture."""
        without = error_map(result, truth) is None
        return result.depth.shape, result.frame.shape, result.frame.has_amplitude, without

    def show(self, result: FusedMap, truth: NDArray[np.float32] | None) -> None:
        """Draw another map of the same kind in the same layout."""
        self.figure.set_layout_engine("none")
        for axes, image, panel in zip(self._axes, self._shown, _panels(result, truth), strict=True):
            axes.set_title(panel.title, fontsize=11)
            image.set_data(panel.image)
            image.set_clim(panel.low, panel.high)
        self.figure.suptitle(_title(result, truth), fontsize=12)

    def save(self, path: Path) -> None:
        """Save it as PNG, whole or not at all."""
        with whole_file(path) as partial:
            # Level 1 is a tenth larger than the default and takes a third of the time.
            self.figure.savefig(partial, format="png", dpi=100, pil_kwargs={"compress_level": 1})


@dataclass(frozen=True, slots=True)
class _Panel:
    """One image, what it is called, and how it is coloured; with `root`, by the square root of its values."""

    image: NDArray[Any]
    colours: str
    unit: str | None
    title: str
    low: float
    high: float
    background: str = "#c8c8c8"
    root: bool = False


def _panels(result: FusedMap, truth: NDArray[np.float32] | None) -> list[_Panel]:
    frame, depth = result.frame, result.depth
    of = f"frame {frame.sequence}"
    size = f"{depth.shape[1]} × {depth.shape[0]}"
    surface = Surface(result.distance, result.intrinsics, result.calibration.distortion or None)
    return [
        _Panel(frame.distance, "viridis", "distance, m", f"{of}: distance", *_range(frame.distance)),
        _amplitude(frame, of),
        _Panel(depth, "viridis", "depth, m", f"fused depth, {size}", *_range(depth)),
        *(_side(surface, yaw, pitch) for yaw, pitch in _VIEWS),
        _judged(result, truth),
    ]


def _amplitude(frame: Frame, of: str) -> _Panel:
    if frame.amplitude is None:
        nothing = np.full(frame.shape, np.nan)
        return _Panel(nothing, "gray", None, f"{of}: the camera gives no amplitude", 0.0, 1.0)
    brightest = max(1.0, float(frame.amplitude.max()))
    return _Panel(frame.amplitude, "gray", "amplitude, counts", f"{of}: amplitude", 0.0, brightest, root=True)


def _side(surface: Surface, yaw: float, pitch: float) -> _Panel:
    side = f"{abs(np.degrees(yaw)):.0f}° from the {'right' if yaw > 0 else 'left'}"
    return _Panel(
        surface.seen_from(yaw, pitch), "gray", None, f"surface, seen {side}", 0.0, 1.0, background="#20242c"
    )


def _judged(result: FusedMap, truth: NDArray[np.float32] | None) -> _Panel:
    error = error_map(result, truth)
    if error is None:
        spread = result.deviation * 1000
        # Where hardly anything came back it is many times what it is elsewhere, and would hide all the rest.
        limit = float(np.nanpercentile(spread, 90)) if np.isfinite(spread).any() else 1.0
        return _Panel(spread, "magma", "standard deviation, mm", "deviation", 0.0, limit)
    known = np.abs(error[np.isfinite(error)]) * 1000
    limit = max(1.0, float(np.percentile(known, 95))) if known.size else 1.0
    name = "error against the truth"
    return _Panel(error * 1000, "RdBu_r", "fused − true distance, mm", name, -limit, limit)


def _show(axes: "Axes", panel: _Panel) -> "AxesImage":
    from matplotlib.colors import Normalize, PowerNorm

    axes.set_facecolor(panel.background)
    scale = (
        PowerNorm(0.5, vmin=panel.low, vmax=panel.high) if panel.root else Normalize(panel.low, panel.high)
    )
    shown = axes.imshow(panel.image, cmap=panel.colours, norm=scale, interpolation="nearest")
    axes.set_title(panel.title, fontsize=11)
    axes.set_xticks([])
    axes.set_yticks([])
    if panel.unit is not None:
        axes.figure.colorbar(
            shown, ax=axes, label=panel.unit, shrink=0.85, extend="neither" if panel.root else "both"
        )
    return shown


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
