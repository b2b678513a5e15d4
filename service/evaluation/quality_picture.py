"""A picture of how well a rig measures: deviations before and after fusion, and the edge across."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.errors import UnmeasurableError
from service.evaluation.figures import plane_in
from service.evaluation.quality import Quality, pair_of, profile_of
from service.evaluation.regions import Region
from service.evaluation.sight import Sight, Take
from service.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BEFORE, _AFTER = "#b45f06", "#1f5fa8"


def write_quality(
    path: Path, quality: Quality, take: Take, regions: Sequence[Region], *, found: bool
) -> None:
    """Draw one burst and save it as PNG, whole or not at all.

    Panels: deviations from the regions' planes of one frame and of the map, on one scale; the map with the
    regions; and the edge across, or how the deviations are spread where there is none.

    Args:
        path: of the picture.
        quality: the figures.
        take: the burst.
        regions: what was judged.
        found: as `measure` has it.

    Raises:
        OutputError: it cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 9.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2)
    before = _deviations(take.before[0], regions, 1) if take.before else None
    after = _deviations(take.after, regions, take.upsampling)
    limit = _limit(after if before is None else before)
    for panel, image, name in ((axes[0, 0], before, "one frame"), (axes[0, 1], after, "fused map")):
        _show_deviations(panel, image, name, limit)
    _show_regions(axes[1, 0], take, regions)
    pair = pair_of(take, regions, found=found)
    profiles = [profile_of(take, pair, after=after) for after in (False, True)]
    if any(profiles):
        _show_edge(axes[1, 1], profiles)
    else:
        _show_spread(axes[1, 1], before, after, limit)
    figure.suptitle(_title(quality), fontsize=12)
    with whole_file(path) as partial:
        figure.savefig(partial, format="png", dpi=100)


def _deviations(sight: Sight, regions: Sequence[Region], factor: int) -> NDArray[np.float64]:
    """(H, W) mm from the plane of the region that a pixel lies in, NaN elsewhere."""
    image = np.full(sight.distance.shape, np.nan)
    for region in regions:
        mask = region.at(factor) & sight.known
        try:
            plane = plane_in(sight, mask)
        except UnmeasurableError:
            continue
        image[mask] = plane.deviations(sight.points(mask)) * 1e3
    return image


def _limit(image: NDArray[np.float64]) -> float:
    known = np.abs(image[np.isfinite(image)])
    return max(0.1, float(np.percentile(known, 95))) if known.size else 1.0


def _show_deviations(axes: "Axes", image: NDArray[np.float64] | None, name: str, limit: float) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    if image is None:
        axes.set_title(f"{name}: not there", fontsize=11)
        return
    known = image[np.isfinite(image)]
    rms = f", RMS {np.sqrt(np.mean(known**2)):.2f} mm" if known.size else ""
    axes.set_facecolor("#d0d0d0")
    shown = axes.imshow(image, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_title(f"{name}: off the best plane{rms}", fontsize=11)
    axes.figure.colorbar(shown, ax=axes, label="mm, > 0 behind it", shrink=0.85, extend="both")


def _show_regions(axes: "Axes", take: Take, regions: Sequence[Region]) -> None:
    image = take.after.distance
    known = image[np.isfinite(image)]
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    axes.set_facecolor("#d0d0d0")
    shown = axes.imshow(image, cmap="viridis", vmin=low, vmax=max(high, low + 1e-3), interpolation="nearest")
    for region in regions:
        mask = region.at(take.upsampling)
        if not mask.all():
            axes.contour(mask, levels=[0.5], colors="white", linewidths=1.2)
        rows, columns = np.nonzero(mask)
        nearest = np.hypot(rows - rows.mean(), columns - columns.mean()).argmin()
        axes.text(
            columns[nearest], rows[nearest], region.name, color="white", fontsize=9, ha="center", va="center"
        )
    axes.set(xticks=[], yticks=[])
    axes.set_title("what is judged", fontsize=11)
    axes.figure.colorbar(shown, ax=axes, label="fused distance, m", shrink=0.85, extend="both")


def _show_edge(axes: "Axes", profiles: Sequence[object]) -> None:
    from service.evaluation.edges import EdgeProfile

    for profile, name, colour in zip(profiles, ("one frame", "fused map"), (_BEFORE, _AFTER), strict=True):
        if isinstance(profile, EdgeProfile):
            label = f"{name}: {profile.width * 1e3:.1f} mm"
            axes.plot(profile.place * 1e3, profile.level * 100, ".-", color=colour, ms=3, lw=1, label=label)
    for level in (10, 90):
        axes.axhline(level, color="0.6", lw=0.8, ls="--")
    axes.set(xlabel="across the edge, mm", ylabel="from one plane to the other, %")
    axes.set_title("the edge, 10 to 90 %", fontsize=11)
    axes.grid(alpha=0.3)
    axes.legend()


def _show_spread(
    axes: "Axes", before: NDArray[np.float64] | None, after: NDArray[np.float64], limit: float
) -> None:
    bins = np.linspace(-1.5 * limit, 1.5 * limit, 81)
    for image, name, colour in ((before, "one frame", _BEFORE), (after, "fused map", _AFTER)):
        if image is not None and np.isfinite(image).any():
            known = image[np.isfinite(image)]
            axes.hist(
                known, bins=bins.tolist(), density=True, histtype="step", color=colour, lw=1.6, label=name
            )
    axes.set(xlabel="off the best plane, mm", ylabel="share of the pixels per mm")
    axes.set_title("how the deviations are spread", fontsize=11)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend()


def _title(quality: Quality) -> str:
    said = [quality.source, f"{quality.bursts} bursts, {quality.frames} frames", quality.method or "?"]
    for name in ("flatness", "noise"):
        figure = getattr(quality, name)
        if figure.before is not None and figure.after is not None:
            said.append(f"{name} {figure.before * 1e3:.1f} → {figure.after * 1e3:.1f} mm")
    return "   ·   ".join(said)
