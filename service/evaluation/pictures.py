"""Pictures of an evaluation: error against λ, coloured error, shaded surfaces, the amplitude's cut-off."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.files import whole_file
from solver.evaluation import Outcome, percent_of_longest_side
from solver.evaluation.protocol import FINE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Image = NDArray[np.float32]

WORST = 5.0
"""Percent of the longest side that is shown in full red; beside an edge a frame errs by more."""


def write_sweep(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Mean squared error against λ, a curve per method, a panel per noise level."""
    variances = list(dict.fromkeys(outcome.variance for outcome in outcomes))
    figure = _figure(4.6 * len(variances), 4.2)
    panels = figure.subplots(1, len(variances), squeeze=False)[0]
    for axes, variance in zip(panels, variances, strict=True):
        rows = [outcome for outcome in outcomes if outcome.variance == variance]
        for method in dict.fromkeys(outcome.method for outcome in rows):
            curve: dict[float, list[float]] = {}
            for outcome in rows:
                if outcome.method == method and outcome.regularization is not None:
                    curve.setdefault(outcome.regularization, []).append(outcome.mse)
            if curve:
                strengths = sorted(curve)
                axes.loglog(
                    strengths, [np.mean(curve[value]) for value in strengths], "o-", ms=3, label=method
                )
        axes.set(xlabel="λ", ylabel="mean squared error", title=f"noise variance {variance:g}")
        axes.grid(alpha=0.3, which="both")
        if axes.get_legend_handles_labels()[0]:
            axes.legend()
    _save(figure, path)


def write_errors(path: Path, maps: dict[str, Image], truth: Image) -> None:
    """|error| of every map in percent of the object's longest side, green to red."""
    figure, panels = _panels(len(maps))
    for axes, (name, fused) in zip(panels, maps.items(), strict=False):
        percent = percent_of_longest_side(fused, truth, pitch=FINE)
        shown = axes.imshow(percent, cmap="RdYlGn_r", vmin=0, vmax=WORST, interpolation="nearest")
        axes.set_title(f"{name}: mean {np.nanmean(percent):.2f} %", fontsize=10)
    figure.colorbar(shown, ax=panels, label="error, % of the longest side", extend="max", shrink=0.8)
    _save(figure, path)


def write_surfaces(path: Path, maps: dict[str, Image]) -> None:
    """Every map as a matt surface lit from the upper left: staircases and smeared edges show at a glance."""
    figure, panels = _panels(len(maps))
    for axes, (name, fused) in zip(panels, maps.items(), strict=False):
        axes.imshow(shaded(fused), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        axes.set_title(name, fontsize=10)
    _save(figure, path)


def write_cutoff(path: Path, amplitude: Image, threshold: float) -> None:
    """The amplitude image, the pixels under the threshold in red."""
    high = float(np.nanpercentile(amplitude, 99))
    grey = np.sqrt(np.clip(np.nan_to_num(amplitude) / max(high, 1e-12), 0, 1))
    colours = np.repeat(grey[..., None], 3, axis=2)
    cut = ~(amplitude >= threshold)
    colours[cut] = (0.85, 0.1, 0.1)
    figure = _figure(6, 5)
    axes = figure.subplots()
    axes.imshow(colours, interpolation="nearest")
    axes.set_title(f"amplitude; {100 * cut.mean():.1f} % under {threshold:.3g} cut off", fontsize=10)
    axes.set_axis_off()
    _save(figure, path)


def shaded(depth: Image) -> Image:
    """Lambert's law on a depth map seen along parallel rays, 0..1, NaN where unknown."""
    down, right = np.gradient(depth, FINE)
    # The normal is (−right, −down, 1) / length, towards the viewer; the light comes from the upper left.
    facing = (0.4 * right + 0.5 * down + 0.77) / np.sqrt(1 + down * down + right * right)
    return np.asarray(0.1 + 0.9 * np.clip(facing, 0, 1), np.float32)


def _panels(count: int) -> "tuple[Figure, list[Axes]]":
    """A figure with at least `count` empty panels, at most four in a row."""
    columns = min(4, count)
    rows = -(-count // columns)
    figure = _figure(3.6 * columns + 0.6, 3.8 * rows)
    panels: list[Axes] = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in panels:
        axes.set_axis_off()
    return figure, panels


def _figure(width: float, height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: "Figure", path: Path) -> None:
    with whole_file(path) as partial:
        figure.savefig(partial, format="png", dpi=110)
