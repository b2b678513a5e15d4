"""One picture per burst: what went in, what came out, and how good it is."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from service.files import whole_file
from service.messages.map import FusedMap
from service.messages.quality import error_map, judge
from service.sinks.shading import Surface
from solver.reason import CONTRADICTED, DARK, FILLED, OUTSIDE, SATURATED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

_VIEWS = ((0.4, 0.15), (-0.4, 0.15))
"""Yaw and pitch of the two viewpoints, radians: far enough round to see relief, not to hide half of it."""


_DEPTH = 2
"""Which panel shows the depth."""

_UNKNOWN = {
    DARK: ("dark", "#000000"),
    SATURATED: ("saturated", "#ffffff"),
    CONTRADICTED: ("contradicted", "#e0457b"),
    OUTSIDE: ("outside", "#b8b8b8"),
}
"""Name and colour by reason; none is a colour of a depth."""


def write_preview(path: Path, result: FusedMap, truth: NDArray[np.float32] | None = None) -> None:
    """Draw a map and save it as PNG, whole or not at all; see `Picture`."""
    Picture(result, truth).save(path)


class Picture:
    """A picture of a map, which may be drawn again for the next one: laying it out takes longest.

    Panels: distance and amplitude of the reference frame, fused depth with the reason where it is unknown,
    the surface from two sides, and the error where there is a truth of the map's size, else the standard
    deviation.

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
        self._reasons = _show_reasons(self._axes[_DEPTH], result.reason)
        self.figure.suptitle(_title(result, truth), fontsize=12)

    @staticmethod
    def kind(result: FusedMap, truth: NDArray[np.float32] | None) -> tuple[object, ...]:
        """Maps of one kind fit the same picture."""
        return result.depth.shape, result.frame.shape, error_map(result, truth) is None

    def show(self, result: FusedMap, truth: NDArray[np.float32] | None) -> None:
        """Draw another map of the same kind in the same layout."""
        self.figure.set_layout_engine("none")
        for axes, image, panel in zip(self._axes, self._shown, _panels(result, truth), strict=True):
            axes.set_title(panel.title, fontsize=11)
            image.set_data(panel.image)
            image.set_clim(panel.low, panel.high)
        self._reasons.set_data(_unknown(result.reason))
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
    brightest = max(1.0, float(frame.amplitude.max()))
    return [
        _Panel(frame.distance, "viridis", "distance, m", f"{of}: distance", *_range(frame.distance)),
        _Panel(frame.amplitude, "gray", "amplitude, counts", f"{of}: amplitude", 0.0, brightest, root=True),
        _Panel(depth, "viridis", "depth, m", f"fused depth, {size}{_shares(result.reason)}", *_range(depth)),
        *(_side(surface, yaw, pitch) for yaw, pitch in _VIEWS),
        _judged(result, truth),
    ]


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


def _show_reasons(axes: "Axes", reason: NDArray[np.uint8]) -> "AxesImage":
    """Paint unknown pixels by their reason, and say below which colour is which."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = [colour for _, colour in _UNKNOWN.values()]
    first = min(_UNKNOWN)
    shown = axes.imshow(
        _unknown(reason),
        cmap=ListedColormap(colours),
        vmin=first - 0.5,
        vmax=first + len(colours) - 0.5,
        interpolation="nearest",
    )
    patches = [Patch(facecolor=c, edgecolor="#404040", label=name) for name, c in _UNKNOWN.values()]
    axes.legend(
        handles=patches, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=4, fontsize=9, frameon=False
    )
    return shown


def _unknown(reason: NDArray[np.uint8]) -> "np.ma.MaskedArray[Any, Any]":
    return np.ma.masked_less(reason, min(_UNKNOWN))


def _shares(reason: NDArray[np.uint8]) -> str:
    """What part of the map is not measured, and why."""
    names = {FILLED: "filled"} | {value: name for value, (name, _) in _UNKNOWN.items()}
    shares = {name: float(np.mean(reason == value)) for value, name in names.items()}
    said = ", ".join(f"{name} {share:.1%}" for name, share in shares.items() if share)
    return f": {said}" if said else ""


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
