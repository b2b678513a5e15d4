"""One picture for each calibration: what it rests on and what is left over."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

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
        covered.plot(*sighting.pixels.T, ".", markersize=3)
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
    scatter, text = figure.subplots(1, 2)
    _scatter(scatter, fit.residuals, fit.error)
    text.axis("off")
    text.text(0.0, 0.5, str(fit).replace("; ", "\n").replace("), ", ")\n"), wrap=True, va="center")


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
    profile, pattern = figure.subplots(1, 2)
    distance, error = fit.profile
    profile.plot(distance, 1e3 * error, "o", markersize=3, label="walls, mean error")
    found = fit.corrections
    at = np.linspace(distance.min(), distance.max(), 400)
    model = np.full_like(at, found.constant)
    for term in found.cyclic:
        model += term.amplitude * np.sin(2 * np.pi * term.harmonic * at / fit.ambiguity_range + term.phase)
    profile.plot(at, 1e3 * model, "-", label="constant and cyclic")
    profile.set(xlabel="measured distance, m", ylabel="error, mm")
    profile.legend()
    if found.per_pixel:
        image = 1e3 * np.array(found.per_pixel)
        limit = float(np.percentile(np.abs(image), 99)) or 1.0
        shown = pattern.imshow(image, cmap="coolwarm", vmin=-limit, vmax=limit)
        figure.colorbar(shown, ax=pattern, label="mm")
        pattern.set_title("pattern of the pixels")
    else:
        pattern.axis("off")


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
