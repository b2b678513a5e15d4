"""The ablations as an experiment: every variant on the same bursts, each at its best λ."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver import fuse
from solver.evaluation.ablations import LAMBDAS, VARIANTS, ablate
from solver.evaluation.experiment import Outcome, Setting, Told, run_method
from solver.evaluation.metrics import Errors, errors
from solver.evaluation.protocol import Trial
from solver.options import FusionOptions

DARK = 1 / 12  # amplitude of black print against its surroundings, about that of carbon ink on card


@dataclass(frozen=True, slots=True)
class Printed:
    """A burst whose object carries a dark print, noisier there by the noise law σ = c / amplitude."""

    trial: Trial
    amplitude: NDArray[np.float32]


def compare_ablations(
    setting: Setting, variances: Iterable[float], seeds: Iterable[int], told: Told | None = None
) -> list[Outcome]:
    """Outcomes of every variant and of the amplitude threshold, at the true displacements."""
    found: list[Outcome] = []
    seeds = list(seeds)
    exact = replace(setting, exact_shifts=True)
    for variance in variances:
        for seed in seeds:
            trial = exact.trial(variance, seed)
            base = errors(run_method(trial, "nearest", exact).distance, trial.truth).mse
            for variant in VARIANTS:
                if told is not None:
                    told(f"{variant.name}, variance {variance:g}, seed {seed}")
                tried = {
                    strength: errors(ablate(trial, variant, strength, setting.upsampling), trial.truth)
                    for strength in LAMBDAS[variant.data]
                }
                best = min(tried, key=lambda strength: tried[strength].mse)
                found.append(_row(variant.name, variance, seed, best, tried[best], base))
            if variance > 0:
                found += _threshold_rows(exact, variance, seed)
    return found


def _threshold_rows(setting: Setting, variance: float, seed: int) -> list[Outcome]:
    printed = dark_print(setting, variance, seed)
    trial = printed.trial
    base = errors(run_method(trial, "nearest", setting).distance, trial.truth).mse
    rows = []
    for name, threshold in (("with amplitude threshold", 2 * DARK), ("without amplitude threshold", 0.0)):
        options = FusionOptions(
            method="lidarboost",
            upsampling=setting.upsampling,
            amplitude_threshold=threshold,
            fill=float(max(trial.distance.shape)),
        )
        fused = fuse(trial.distance, printed.amplitude, options=options, shifts=trial.shifts)
        strength = fused.report.regularization
        rows.append(_row(name, variance, seed, strength, errors(fused.distance, trial.truth), base))
    return rows


def dark_print(setting: Setting, variance: float, seed: int) -> Printed:
    """The burst of a noise level and a seed, with a dark band across the middle of the scene."""
    clean, trial = setting.trial(0.0, seed), setting.trial(variance, seed)
    rows, columns = trial.distance.shape[1:]
    y = np.arange(rows)[None, :, None] + trial.shifts[:, 0, None, None]
    x = np.arange(columns)[None, None, :] + trial.shifts[:, 1, None, None]
    inside = (np.abs(y / rows - 0.55) < 0.07) & (np.abs(x / columns - 0.4) < 0.18)
    amplitude = np.where(inside, DARK, 1.0).astype(np.float32)
    distance = clean.distance + (trial.distance - clean.distance) / amplitude
    return Printed(replace(trial, distance=distance.astype(np.float32)), amplitude)


def _row(
    name: str, variance: float, seed: int, strength: float | None, error: Errors, base: float
) -> Outcome:
    return Outcome(
        method=name,
        variance=variance,
        seed=seed,
        regularization=strength,
        mse=error.mse,
        rmse=error.rmse,
        mae=error.mae,
        relative=error.mse / base,
        coverage=error.coverage,
        registration=0.0,
        iterations=0,
        gap=None,
        converged=True,
        seconds=0.0,
    )
