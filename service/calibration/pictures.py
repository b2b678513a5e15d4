"""One picture for each calibration: what it rests on and what is left over."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drivers.poses import camera_rotation
from service.calibration.distance import DistanceFit
from service.calibration.intrinsics import CELLS, IntrinsicsFit
from service.calibration.mount import MountFit
from service.calibration.noise import NoiseFit
from service.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

Fit = IntrinsicsFit | DistanceFit | NoiseFit | MountFit


def save_picture(path: Path, fit: Fit, shape: tuple[int, int]) -> None:
    """Draw a calibration and save it as PNG, whole or not at all; `shape`: rows, columns."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5), layout="constrained")
    FigureCanvasAgg(figure)
    if isinstance(fit, IntrinsicsFit):
        _draw_intrinsics(figure, fit, shape)
    elif isinstance(fit, DistanceFit):
        _draw_distance(figure, fit)
    elif isinstance(fit, NoiseFit):
        _draw_noise(figure, fit)
    else:
        _draw_mount(figure, fit)
    with whole_file(path) as partial:
        figure.savefig(partial, format="png", dpi=100)


def _draw_intrinsics(figure: Figure, fit: IntrinsicsFit, shape: tuple[int, int]) -> None:
    covered, left = figure.subplots(1, 2)
    for sighting in fit.sightings:
        (drawn,) = covered.plot(*sighting.pixels.T, ".", markersize=3)
        outline = np.vstack([sighting.outline, sighting.outline[:1]])
        covered.plot(*outline.T, "-", color=drawn.get_color(), linewidth=0.7, alpha=0.6)
    for row in np.linspace(0, shape[0], CELLS[0] + 1):
        covered.axhline(row - 0.5, color="0.8", linewidth=0.5)
    for column in np.linspace(0, shape[1], CELLS[1] + 1):
        covered.axvline(column - 0.5, color="0.8", linewidth=0.5)
    covered.set(
        xlim=(-0.5, shape[1] - 0.5),
        ylim=(shape[0] - 0.5, -0.5),
        aspect="equal",
        title=f"{len(fit.sightings)} views cover {100 * fit.coverage:.0f} %",
        xlabel="column",
        ylabel="row",
    )
    _scatter(left, fit.residuals, fit.error)


def _draw_mount(figure: Figure, fit: MountFit) -> None:
    scatter, top, side = figure.subplots(1, 3)
    _scatter(scatter, fit.residuals, fit.error)
    ahead = camera_rotation(0.0, 0.0, fit.mount)[:, 2]
    arm = 1e3 * np.array(fit.mount.lever_arm)
    reach = 2.5 * max(50.0, float(np.abs(arm).max()))
    for axes, across, title, label in ((top, 0, "from above", "right, mm"), (side, 1, "from the right", "")):
        axes.axhline(0, color="0.8", linewidth=0.5)
        axes.axvline(0, color="0.8", linewidth=0.5)
        axes.plot(0, 0, "k+", markersize=14, label="stage's axes")
        place = (arm[across], arm[2]) if across == 0 else (arm[2], arm[across])
        way = (ahead[across], ahead[2]) if across == 0 else (ahead[2], ahead[across])
        axes.plot(*place, "o", label="projection centre")
        axes.annotate(
            "",
            xy=(place[0] + 0.5 * reach * way[0], place[1] + 0.5 * reach * way[1]),
            xytext=place,
            arrowprops={"arrowstyle": "->", "color": "C0"},
        )
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=title, xlabel=label)
    top.set_ylabel("forward, mm")
    side.set(xlabel="forward, mm", ylabel="down, mm", ylim=(reach, -reach))
    top.legend(loc="lower left")
    figure.suptitle("\n".join(str(fit).split("; ")), fontsize="medium")


def _draw_noise(figure: Figure, fit: NoiseFit) -> None:
    axes = figure.subplots()
    trusted = fit.trusted
    axes.loglog(fit.amplitude[trusted], 1e3 * fit.sigma[trusted], "o", label="measured")
    axes.loglog(fit.amplitude[~trusted], 1e3 * fit.sigma[~trusted], "x", color="0.6", label="wraps, not used")
    law = fit.law.coefficient / fit.amplitude
    axes.loglog(fit.amplitude, 1e3 * law, "-", label=f"{fit.law.coefficient:.4g} m / amplitude")
    axes.set(xlabel="amplitude, counts", ylabel="σ of the distance, mm", title=f"{fit.frames} frames")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()


def _draw_distance(figure: Figure, fit: DistanceFit) -> None:
    found = fit.corrections
    widths = (1.0, 0.8, 1.4) if found.per_pixel else (1.0, 1.0)
    profile, walls, *pattern = figure.subplots(1, len(widths), width_ratios=widths)
    distance, error = fit.profile
    profile.plot(distance, 1e3 * error, "o", markersize=3, label="walls, mean error")
    at = np.linspace(distance.min(), distance.max(), 400)
    smooth = found.model_copy(update={"per_pixel": ()}).error(at, fit.ambiguity_range)
    profile.plot(at, 1e3 * smooth, "-", label="constant and cyclic")
    profile.set(xlabel="measured distance, m", ylabel="error, mm", title="error by distance")
    low, high = 1e3 * min(smooth.min(), error.min()), 1e3 * max(smooth.max(), error.max())
    room = max(10.0, high - low)
    profile.set_ylim(low - 0.1 * room, high + 0.35 * room)  # room for the legend
    profile.legend(loc="upper left")
    numbers = np.arange(1, len(fit.walls) + 1)
    walls.bar(numbers, 1e3 * np.array(fit.walls))
    walls.set(
        xlabel="wall",
        ylabel="residual without noise, mm",
        xticks=numbers,
        ylim=(0, max(10.0, 1.2e3 * max(fit.walls))),
        title=f"residual {1e3 * fit.before:.1f} mm before,\n{1e3 * fit.after:.1f} mm after, with noise",
    )
    for axes in pattern:
        image = 1e3 * np.array(found.per_pixel)
        limit = float(np.percentile(np.abs(image), 99)) or 1.0
        shown = axes.imshow(image, cmap="coolwarm", vmin=-limit, vmax=limit)
        figure.colorbar(shown, ax=axes, label="mm", shrink=0.7)
        axes.set(title=f"pattern of the pixels, {image.std():.1f} mm RMS", xlabel="column", ylabel="row")


def _scatter(axes: Axes, residuals: NDArray[np.float64], error: float) -> None:
    axes.plot(*residuals.T, ".", markersize=3)
    limit = max(0.3, 1.1 * float(np.abs(residuals).max()))
    axes.set(
        xlim=(-limit, limit),
        ylim=(limit, -limit),
        aspect="equal",
        title=f"reprojection error {error:.3f} pixels RMS",
        xlabel="columns",
        ylabel="rows",
    )
    axes.grid(True, alpha=0.3)
