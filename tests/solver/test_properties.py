"""What must hold for any input that is not refused."""

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver import Fused, FusionInputError, FusionOptions, FusionWarning, fuse
from solver.runtime.threads import ALONE

METHODS = ["nearest", "lidarboost", "area", "phasor"]
PROFILE = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)


@st.composite
def bursts(draw: st.DrawFn) -> dict[str, np.ndarray]:
    """Any shape, some pixels NaN, some dark, some shifts far out of view, any unit."""
    count, rows, columns = draw(st.integers(1, 4)), draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    unit = draw(st.sampled_from([1e-6, 1.0, 1e6]))
    spread = draw(st.sampled_from([0.0, 0.01, 1.0]))
    distance = unit * (2 + spread * rng.normal(size=(count, rows, columns))).clip(0.1, 7)
    distance[rng.random(distance.shape) < draw(st.sampled_from([0.0, 0.3, 0.95]))] = np.nan
    amplitude = rng.uniform(0, 1000, distance.shape)
    amplitude[rng.random(distance.shape) < draw(st.sampled_from([0.0, 0.5, 1.0]))] = 0
    shifts = rng.normal(scale=draw(st.sampled_from([0.0, 0.5, 20.0])), size=(count, 2))
    return {"distance": distance, "amplitude": amplitude, "shifts": shifts, "range": np.float64(7.5 * unit)}


def fused_or_refused(burst: dict[str, np.ndarray], options: FusionOptions) -> Fused | None:
    """The result, or None where the solver refuses the burst and says so."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FusionWarning)
            return fuse(
                burst["distance"],
                burst["amplitude"],
                shifts=burst["shifts"],
                ambiguity_range=float(burst["range"]),
                options=options,
            )
    except FusionInputError:
        return None


@pytest.mark.parametrize("method", METHODS)
@PROFILE
@given(burst=bursts(), factor=st.integers(1, 4))
def test_a_map_or_a_clear_refusal(method: str, burst: dict[str, np.ndarray], factor: int) -> None:
    options = FusionOptions(method=method, upsampling=factor, max_iterations=40)  # type: ignore[arg-type]
    distance = burst["distance"]
    fused = fused_or_refused(burst, options)
    if fused is None:
        return
    rows, columns = distance.shape[1:]
    assert fused.distance.shape == fused.deviation.shape == (factor * rows, factor * columns)
    known = np.isfinite(fused.distance)
    assert np.array_equal(known, np.isfinite(fused.deviation))
    assert (fused.deviation[known] >= 0).all()
    low, high = np.nanmin(distance), np.nanmax(distance)
    margin = 1e-3 * float(burst["range"])
    if method in ("nearest", "lidarboost"):
        assert (fused.distance[known] >= low - margin).all()
        assert (fused.distance[known] <= high + margin).all()
    assert fused.report.gap is None or fused.report.gap >= 0
    assert set(fused.report.used) | set(fused.report.rejected) == set(range(len(distance)))


@pytest.mark.parametrize("method", ["lidarboost", "area"])
@PROFILE
@given(seed=st.integers(0, 1000), order=st.permutations(range(4)))
def test_the_order_of_the_frames_does_not_matter(method: str, seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    distance = 2 + 0.1 * rng.normal(size=(4, 7, 8))
    shifts = rng.uniform(-1, 1, (4, 2))
    options = FusionOptions(method=method, regularization=0.05, tolerance=1e-4)  # type: ignore[arg-type]
    first = fuse(distance, shifts=shifts, options=options)
    again = fuse(distance[order], shifts=shifts[order], options=options)
    assert again.report.objective == pytest.approx(first.report.objective, rel=5e-4)
    np.testing.assert_allclose(again.distance, first.distance, atol=1e-2)


@PROFILE
@given(lift=st.floats(-1.0, 5.0), seed=st.integers(0, 1000))
def test_moving_the_scene_moves_the_map(lift: float, seed: int) -> None:
    distance = 2 + 0.1 * np.random.default_rng(seed).normal(size=(2, 6, 7))
    # Two frames leave nine pixels in ten to the prior, which takes long to settle.
    options = FusionOptions(method="lidarboost", regularization=0.05, tolerance=1e-4, max_iterations=10_000)
    shifts = np.array([[0, 0], [0.4, 0.3]])
    first = fuse(distance, shifts=shifts, options=options, noise=0.1)
    lifted = fuse(distance + lift, shifts=shifts, options=options, noise=0.1)
    np.testing.assert_allclose(lifted.distance - lift, first.distance, atol=2e-3)


def test_wrapped_distances_meet_across_the_wrap() -> None:
    """Half the noise of a wall at the ambiguity range comes out at its far end, half at 0."""
    rng = np.random.default_rng(5)
    distance = np.mod(7.5 + 0.02 * rng.normal(size=(8, 12, 12)), 7.5)
    fused = fuse(
        distance, np.full_like(distance, 500.0), shifts=rng.uniform(-1, 1, (8, 2)), ambiguity_range=7.5
    )
    off = np.abs((fused.distance[12:-12, 12:-12] + 3.75) % 7.5 - 3.75)
    assert off.max() < 0.03


def test_the_result_does_not_depend_on_the_threads_or_on_what_ran_before() -> None:
    import numba

    rng = np.random.default_rng(7)
    distance = 2 + 0.1 * rng.normal(size=(5, 60, 50)).astype(np.float32)
    shifts = rng.uniform(-1, 1, (5, 2))
    assert distance[0].size * 16 > ALONE  # smaller images run on one thread anyway
    light = np.full_like(distance, 800.0)
    for method in ("lidarboost", "area", "phasor"):
        options = FusionOptions(method=method)  # type: ignore[arg-type]
        first = fuse(distance, light, shifts=shifts, ambiguity_range=7.5, options=options)
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            alone = fuse(distance, light, shifts=shifts, ambiguity_range=7.5, options=options)
        finally:
            numba.set_num_threads(before)
        np.testing.assert_array_equal(first.distance, alone.distance)
