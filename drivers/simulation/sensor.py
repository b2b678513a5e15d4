"""The sensor: four phase samples of the received phasor, noise, saturation, and 16-bit counts.

A lock-in pixel correlates the light with the modulation at four phases, one after the other (Lange and Seitz,
IEEE J. Quantum Electronics 37(3), 2001): s_k = Re(P_k · exp(−i k π/2)), P_k what the pixel receives during
sample k. Both taps of the pixel see the same unmodulated light, so it cancels. The phasor measured is
(s0 − s2)/2 + i (s1 − s3)/2; its angle is 2π · distance / ambiguity range, its length the amplitude. A stage
that turns meanwhile mixes poses.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Corrections
from drivers.frame import COUNTS_PER_RANGE
from drivers.settings import CameraSettings

GAIN = 3000 / (0.6 / 2.0**2) / 0.030
"""Counts · m² per second: a surface of reflectivity 0.6 at 2 m gives 3,000 counts in 30 ms."""

NOISE_COEFFICIENT = 30.0
"""m · counts at 20 MHz: σ(distance) = 30 / amplitude, 10 mm at the 3,000 counts above."""

FULL_SCALE = 0xFFFF
"""Counts at which a phase sample saturates."""

_ROUNDS = 12
"""Each leaves a fifth of what is missing, with a cyclic error as strong as 60 mm in the fourth harmonic."""

_NOISE_RANGE = 7.5
"""m, the ambiguity range at which `NOISE_COEFFICIENT` holds."""

PHASE_NOISE = NOISE_COEFFICIENT * 2 * np.pi / _NOISE_RANGE
"""Counts, standard deviation of each of the phasor's two components: σ(angle) = PHASE_NOISE / amplitude."""


def phase_noise(coefficient: float, ambiguity_range: float) -> float:
    """Counts, of each component, for σ(distance) = coefficient / amplitude at that range."""
    return coefficient * 2 * np.pi / ambiguity_range


def noise_coefficient(ambiguity_range: float) -> float:
    """c in σ(distance) = c / amplitude, m · counts; noise of the angle weighs more on a longer range."""
    return NOISE_COEFFICIENT * ambiguity_range / _NOISE_RANGE


def expose(
    correlations: NDArray[np.float64],
    settings: CameraSettings,
    noise: np.random.Generator | None,
    phase_noise: float = PHASE_NOISE,
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Measure what was received during the four samples.

    Args:
        correlations: (4, H, W) Re P0, Im P1, Re P2, Im P3 in 1/m² (see `Renderer.correlations`).
        settings: integration time, amplitude mode and threshold.
        noise: source of the noise, or None for a sensor without any.
        phase_noise: standard deviation of each of the phasor's two components, counts.

    Returns:
        (H, W) counts of distance (0 = rejected) and of amplitude.
    """
    shape = correlations.shape[1:]
    counts, amplitude = np.empty(shape, np.uint16), np.empty(shape, np.uint16)
    noises = np.zeros((4, *shape), np.float32)
    if noise is not None:
        noise.standard_normal(out=noises, dtype=np.float32)
        # Each component is half the difference of two samples, so √2 of its deviation belongs to each sample.
        noises *= np.float32(np.sqrt(2) * phase_noise)
    metres = settings.ambiguity_range / COUNTS_PER_RANGE if settings.amplitude_mode == "gray" else 0.0
    gain = GAIN * settings.integration_time
    _measure(correlations, noises, gain, settings.amplitude_threshold, metres, counts, amplitude)
    return counts, amplitude


def with_errors(
    counts: NDArray[np.uint16], corrections: Corrections, ambiguity_range: float
) -> NDArray[np.uint16]:
    """Counts (H, W) of a sensor whose distances err by what `corrections` take out again."""
    metres = ambiguity_range / COUNTS_PER_RANGE
    true = counts * metres
    measured = true
    for _ in range(_ROUNDS):  # errors are functions of what is measured
        measured = true + corrections.error(measured, ambiguity_range)
    wrapped = np.rint(measured / metres).astype(np.int64) % COUNTS_PER_RANGE
    return np.where(counts > 0, np.maximum(wrapped, 1), 0).astype(np.uint16)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _measure(received, noises, gain, threshold, metres, counts, amplitude) -> None:  # type: ignore[no-untyped-def]
    """Samples to counts and amplitude; `metres` per count for gray mode, 0 for linear."""
    for i in range(counts.shape[0]):
        for j in range(counts.shape[1]):
            s0 = gain * received[0, i, j] + noises[0, i, j]
            s1 = gain * received[1, i, j] + noises[1, i, j]
            s2 = -gain * received[2, i, j] + noises[2, i, j]
            s3 = -gain * received[3, i, j] + noises[3, i, j]
            saturated = max(abs(s0), abs(s1), abs(s2), abs(s3)) >= FULL_SCALE
            real = 0.5 * (_clipped(s0) - _clipped(s2))
            imaginary = 0.5 * (_clipped(s1) - _clipped(s3))
            strength = np.sqrt(real * real + imaginary * imaginary)
            turns = np.arctan2(imaginary, real) / (2 * np.pi)
            count = int(np.rint(turns * COUNTS_PER_RANGE)) % COUNTS_PER_RANGE
            # A distance of exactly a whole number of ranges is one count, since zero means rejected.
            counts[i, j] = 0 if strength < threshold else max(count, 1)
            if metres > 0.0:
                strength *= (count * metres) ** 2
            # Gray mode may exceed 16 bits although no sample saturated; full scale comes out either way.
            over = saturated or strength >= FULL_SCALE
            amplitude[i, j] = FULL_SCALE if over else int(np.rint(strength))


@numba.njit(cache=True, nogil=True)
def _clipped(sample: float) -> float:
    return float(min(max(sample, -FULL_SCALE), FULL_SCALE))
