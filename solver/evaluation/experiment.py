"""Methods compared on a known depth map: seeds, noise levels, λ."""

import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver import fuse
from solver.errors import FusionWarning
from solver.evaluation.metrics import errors
from solver.evaluation.protocol import DepthMap, Region, Trial, make_trial
from solver.options import FusionOptions, Method
from solver.result import Fused

Lambda = float | Literal["auto"]
Told = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """One method on one burst.

    Attributes:
        method: or the variant, in ablations.
        variance: of the noise, in the paper's unit (depth on 0..182).
        seed: of displacements and noise.
        regularization: the λ used.
        mse, rmse, mae: errors over all pixels.
        relative: mse over that of one frame, nearest, in the same burst.
        coverage: share of pixels that the map covers.
        registration: RMS error of the displacements, low-resolution pixels; 0 where the true ones were given.
        iterations, gap, converged: as in `Report`.
        seconds: registration and solve.
    """

    method: str
    variance: float
    seed: int
    regularization: float | None
    mse: float
    rmse: float
    mae: float
    relative: float
    coverage: float
    registration: float
    iterations: int
    gap: float | None
    converged: bool
    seconds: float


@dataclass(frozen=True, slots=True)
class Setting:
    """What all runs of an experiment share."""

    depth: DepthMap
    frames: int = 10
    upsampling: int = 4
    region: Region | None = None
    exact_shifts: bool = False

    def trial(self, variance: float, seed: int) -> Trial:
        """The burst of a noise level and a seed."""
        return make_trial(
            self.depth,
            variance=variance,
            seed=seed,
            frames=self.frames,
            upsampling=self.upsampling,
            region=self.region,
        )


def run_method(
    trial: Trial,
    method: Method,
    setting: Setting,
    *,
    regularization: Lambda = "auto",
    shifts: NDArray[np.float64] | None = None,
) -> Fused:
    """Fuse a burst; shifts are estimated unless given or the setting wants the true ones."""
    options = FusionOptions(method=method, upsampling=setting.upsampling, regularization=regularization)
    known = trial.shifts if setting.exact_shifts else shifts
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FusionWarning)  # `converged` is in the table
        return fuse(trial.distance, options=options, shifts=known)


def compare(
    setting: Setting,
    methods: Sequence[Method],
    variances: Iterable[float],
    seeds: Iterable[int],
    *,
    lambdas: Sequence[Lambda] = ("auto",),
    told: Told | None = None,
) -> list[Outcome]:
    """Every method at every λ on every burst.

    Raises:
        FusionInputError: a setting cannot be fused.
    """
    found: list[Outcome] = []
    seeds = list(seeds)
    for variance in variances:
        for seed in seeds:
            trial = setting.trial(variance, seed)
            base = errors(run_method(trial, "nearest", setting).distance, trial.truth).mse
            for method in methods:
                for strength in lambdas:
                    if told is not None:
                        told(f"{method}, variance {variance:g}, seed {seed}, λ {strength}")
                    found.append(_outcome(trial, method, setting, variance, seed, strength, base))
    return found


def _outcome(
    trial: Trial,
    method: Method,
    setting: Setting,
    variance: float,
    seed: int,
    strength: Lambda,
    base: float,
) -> Outcome:
    begin = time.perf_counter()
    fused = run_method(trial, method, setting, regularization=strength)
    seconds = time.perf_counter() - begin
    error = errors(fused.distance, trial.truth)
    return Outcome(
        method=method,
        variance=variance,
        seed=seed,
        regularization=fused.report.regularization,
        mse=error.mse,
        rmse=error.rmse,
        mae=error.mae,
        relative=error.mse / base,
        coverage=error.coverage,
        registration=float(np.sqrt(np.mean((fused.shifts - trial.shifts) ** 2))),
        iterations=fused.report.iterations,
        gap=fused.report.gap,
        converged=fused.report.converged,
        seconds=seconds,
    )
