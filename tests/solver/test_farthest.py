"""What is too far to be measured is left out and counted, and what may be far is kept."""

import numpy as np
import pytest
from made_bursts import burst

from solver import FusionInputError, FusionOptions, SlidingFusion, fuse
from solver.evaluation import errors
from solver.options import Method
from solver.preparation.farthest import find_farthest, without

RANGE = 7.5
CODE = 65535.0


def coded(distance: np.ndarray) -> np.ndarray:
    """The frames with a code in the place of one distance in fifty."""
    return np.where(np.random.default_rng(7).random(distance.shape) < 0.02, np.float32(CODE), distance)


@pytest.mark.parametrize("frames", [2, 10])
@pytest.mark.parametrize(
    ("method", "ambiguity_range"),
    [("lidarboost", RANGE), ("lidarboost", None), ("area", RANGE), ("area", None), ("phasor", RANGE)],
)
def test_codes_that_nobody_has_masked_do_no_harm(
    method: Method, ambiguity_range: float | None, frames: int
) -> None:
    scene, options = burst(0.01, frames=frames), FusionOptions(method=method, upsampling=2)
    distance, truth = coded(scene.distance), scene.truth[::2, ::2]

    def fused(distance: np.ndarray) -> tuple[float, float]:
        light = np.full_like(distance, 1000.0)
        found = fuse(distance, light, shifts=scene.shifts, options=options, ambiguity_range=ambiguity_range)
        assert found.report.iterations < 200
        return errors(found.distance, truth).rmse, found.report.contradicted

    (quiet, _), (rmse, contradicted) = fused(scene.distance), fused(distance)
    assert rmse < 1.1 * quiet
    assert contradicted == pytest.approx(float(np.mean(distance == CODE)), abs=2e-4)


def test_frames_with_codes_are_registered_as_without() -> None:
    scene = burst(0.01, frames=4)
    fused = fuse(coded(scene.distance), options=FusionOptions(method="shift-and-add"))
    np.testing.assert_allclose(fused.shifts, scene.shifts, atol=0.1)


@pytest.mark.parametrize("ambiguity_range", [RANGE, None])
def test_a_broken_frame_is_rejected_by_name(ambiguity_range: float | None) -> None:
    scene, options = burst(0.01), FusionOptions(method="area", upsampling=1)
    broken = scene.distance.copy()
    broken[7] *= np.float32(1e30)
    rest = np.arange(10) != 7
    fused = fuse(broken, shifts=scene.shifts, ambiguity_range=ambiguity_range, options=options)
    alone = fuse(
        scene.distance[rest], shifts=scene.shifts[rest], ambiguity_range=ambiguity_range, options=options
    )
    assert fused.report.rejected == {7: "no valid pixel"}
    np.testing.assert_array_equal(fused.distance, alone.distance)


@pytest.mark.parametrize("method", ["lidarboost", "area"])
def test_a_stream_leaves_codes_out_of_new_frames(method: Method) -> None:
    scene, options = burst(0.01, frames=14), FusionOptions(method=method, upsampling=2)
    distance = coded(scene.distance)
    distance[:8] = scene.distance[:8]
    stream = SlidingFusion(options, window=8, ambiguity_range=RANGE, noise=0.01)
    for frame, shift in zip(distance, scene.shifts, strict=True):
        fused = stream.push(frame, shift=shift)
    assert fused.distance.min() > 0.5
    assert fused.distance.max() < 3.5
    assert fused.report.contradicted == pytest.approx(float(np.mean(distance[6:] == CODE)), abs=1e-3)


def test_a_stream_in_another_unit_than_its_range_is_refused() -> None:
    stream = SlidingFusion(FusionOptions(), window=8, ambiguity_range=RANGE)
    with pytest.raises(FusionInputError, match="same unit"):
        stream.push(np.full((8, 9), 1500.0), shift=np.zeros(2))


@pytest.mark.parametrize("ambiguity_range", [RANGE, None])
def test_what_is_unwrapped_or_far_is_kept(ambiguity_range: float | None) -> None:
    distance = np.full((3, 8, 9), 0.3, np.float32)
    distance[:, 2:4] = 2.9 * RANGE
    distance[0, 5] = np.nan
    kept, beyond = without(distance, find_farthest(distance, ambiguity_range))
    assert kept is distance
    np.testing.assert_array_equal(beyond, 0)


@pytest.mark.parametrize("value", [0.0, 3e38])
def test_nothing_is_too_far_where_all_is_as_far(value: float) -> None:
    distance = np.full((2, 3, 4), value, np.float32)
    kept, beyond = without(distance, find_farthest(distance, None))
    assert kept is distance
    assert not beyond.any()


def test_codes_are_no_noise_of_a_stream() -> None:
    rng = np.random.default_rng(4)
    frames = (2 + 0.01 * rng.normal(size=(3, 20, 24))).astype(np.float32)
    frames[rng.random(frames.shape) < 0.1] = 65535
    sliding = SlidingFusion(FusionOptions(method="area", upsampling=2), window=3)
    for frame in frames:
        fused = sliding.push(frame, shift=[0, 0])
    assert fused.report.noise == pytest.approx(0.01, rel=0.3)


def test_a_frame_of_another_unit_does_not_come_into_the_window() -> None:
    frame = np.full((20, 24), 2, np.float32)
    sliding = SlidingFusion(FusionOptions(method="area", upsampling=2), window=3, ambiguity_range=7.5)
    with pytest.raises(FusionInputError, match="same unit"):
        sliding.push(1000 * frame, shift=[0, 0])
    assert sliding.push(frame, shift=[0, 0]).report.used == (0,)
