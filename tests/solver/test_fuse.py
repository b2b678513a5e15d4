"""The contract of `fuse`: what goes in, what comes out, what is refused."""

import numpy as np
import pytest

from solver import Footprint, FusionInputError, FusionOptions, FusionWarning, fuse

FRAMES, ROWS, COLUMNS = 6, 12, 16
SHIFTS = np.array([[0, 0], [0.25, 0.5], [-0.5, 0.25], [0.5, -0.25], [-0.25, -0.5], [0.1, 0.6]])


def step(noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Frames of a wall at 2 with a block at 1.5 in its middle."""
    scene = np.full((ROWS, COLUMNS), 2.0)
    scene[3:9, 5:11] = 1.5
    draw = np.random.default_rng(seed).normal(size=(FRAMES, ROWS, COLUMNS))
    return (scene + noise * draw).astype(np.float32)


def nearest_options(**options: object) -> FusionOptions:
    return FusionOptions(**{"method": "lidarboost", **options})  # type: ignore[arg-type]


def test_shapes_types_and_report() -> None:
    fused = fuse(step(0.01), shifts=SHIFTS, options=nearest_options(upsampling=3))
    assert fused.distance.shape == fused.deviation.shape == (3 * ROWS, 3 * COLUMNS)
    assert fused.distance.dtype == fused.deviation.dtype == np.float32
    assert fused.amplitude is None
    assert fused.rotations is None
    np.testing.assert_array_equal(fused.shifts, SHIFTS)
    report = fused.report
    assert report.method == "lidarboost"
    assert report.used == tuple(range(FRAMES))
    assert report.rejected == {}
    assert report.converged
    assert report.iterations > 0
    assert report.regularization is not None
    assert report.regularization > 0
    assert report.objective is not None
    assert report.gap is not None
    assert 0 <= report.gap < 0.1
    assert report.noise == pytest.approx(0.01, rel=0.3)
    assert report.seconds.solve > 0


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_result_scales_with_the_unit(unit: float) -> None:
    metres = fuse(step(0.01), shifts=SHIFTS, options=nearest_options())
    scaled = fuse(step(0.01) * np.float32(unit), shifts=SHIFTS, options=nearest_options())
    np.testing.assert_allclose(scaled.distance / unit, metres.distance, atol=2e-3)
    np.testing.assert_allclose(scaled.deviation / unit, metres.deviation, rtol=1e-2)


def test_constant_frames_give_the_constant() -> None:
    frames = np.full((3, 8, 8), 1.75, np.float32)
    fused = fuse(frames, shifts=np.zeros((3, 2)), options=nearest_options())
    np.testing.assert_allclose(fused.distance, 1.75, atol=1e-5)


def test_one_frame_and_factor_one() -> None:
    frame = step()[:1]
    fused = fuse(frame, shifts=[[0, 0]], options=nearest_options(upsampling=1, regularization=1e-4))
    np.testing.assert_allclose(fused.distance, frame[0], atol=1e-3)


def test_frames_without_a_valid_pixel_are_named() -> None:
    frames = step(0.01)
    frames[2] = np.nan
    fused = fuse(frames, shifts=SHIFTS, options=nearest_options())
    assert 2 not in fused.report.used
    assert list(fused.report.rejected) == [2]
    assert "valid" in fused.report.rejected[2]


def test_a_frame_far_out_of_view_changes_nothing() -> None:
    shifts = SHIFTS.copy()
    shifts[5] = [1000, -1000]
    fused = fuse(step(), shifts=shifts, options=nearest_options())
    without = fuse(step()[:5], shifts=shifts[:5], options=nearest_options())
    np.testing.assert_allclose(fused.distance, without.distance, atol=1e-6)


def test_fill_reaches_as_far_as_asked() -> None:
    frames = np.full((2, 20, 20), 3.0, np.float32)
    frames[:, :, 10:] = np.nan
    options = nearest_options(upsampling=4, fill=2.0)
    fused = fuse(frames, shifts=np.zeros((2, 2)), options=options)
    finite = np.isfinite(fused.distance[42])
    # The last sample lies in fused column 9 · 4 + 2; two low-resolution pixels are eight columns.
    assert np.flatnonzero(finite).max() == 9 * 4 + 2 + 8
    np.testing.assert_allclose(fused.distance[42][finite], 3.0, atol=1e-4)
    assert np.array_equal(np.isfinite(fused.deviation), np.isfinite(fused.distance))


def test_dark_samples_are_left_out_by_the_threshold() -> None:
    frames = step()
    amplitude = np.full_like(frames, 1000.0)
    frames[:, 4:7, 2:5] = 9.0  # so large that all frames see it in the same place
    amplitude[:, 4:7, 2:5] = 1.0
    kept = fuse(frames, amplitude, shifts=SHIFTS, options=nearest_options(amplitude_threshold=0.0))
    cut = fuse(frames, amplitude, shifts=SHIFTS, options=nearest_options())
    assert np.nanmax(kept.distance) > 4
    assert np.nanmax(cut.distance) < 2.1


def test_stopping_early_warns_and_says_so() -> None:
    with pytest.warns(FusionWarning, match="max_iterations"):
        fused = fuse(step(0.01), shifts=SHIFTS, options=nearest_options(max_iterations=3))
    assert not fused.report.converged
    assert fused.report.iterations == 3


def test_progress_is_called_and_cancels() -> None:
    class CancelledError(Exception):
        pass

    seen: list[int] = []

    def watch(iteration: int, objective: float, gap: float | None) -> None:
        seen.append(iteration)
        assert objective > 0
        assert gap is None or gap >= 0
        if len(seen) == 2:
            raise CancelledError

    with pytest.raises(CancelledError):
        fuse(step(0.01), shifts=SHIFTS, options=nearest_options(), progress=watch)
    assert seen == sorted(seen)
    assert len(seen) == 2


def test_nearest_repeats_the_reference_frame() -> None:
    frames = step(0.02)
    fused = fuse(frames, shifts=SHIFTS, options=FusionOptions(method="nearest"))
    np.testing.assert_array_equal(fused.distance, frames[0].repeat(4, 0).repeat(4, 1))


REFUSED = {
    "two dimensions": ({"distance": np.ones((4, 4))}, "N, H, W"),
    "no frame": ({"distance": np.ones((0, 4, 4))}, "no frame"),
    "no pixel": ({"distance": np.ones((2, 0, 4))}, "without pixels"),
    "all NaN": ({"distance": np.full((2, 4, 4), np.nan)}, "no valid pixel"),
    "infinite": ({"distance": np.full((2, 4, 4), np.inf)}, "infinite"),
    "complex": ({"distance": np.ones((2, 4, 4), complex)}, "real"),
    "ragged": ({"distance": [[1.0], [1.0, 2.0]]}, "not an array"),
    "amplitude shape": ({"amplitude": np.ones((2, 4, 5))}, "amplitude has shape"),
    "negative amplitude": ({"amplitude": np.full((2, 4, 4), -1.0)}, "negative"),
    "dark amplitude": (
        {"amplitude": np.ones((2, 4, 4)), "options": nearest_options(amplitude_threshold=2.0)},
        "amplitude_threshold",
    ),
    "NaN shifts": ({"shifts": [[0, 0], [np.nan, 0]]}, "finite"),
    "shift shape": ({"shifts": [[0, 0]]}, "shifts has shape"),
    "shifts and rotations": (
        {"rotations": np.zeros((2, 3)), "intrinsics": np.eye(3)},
        "shifts and rotations",
    ),
    "out of view": ({"shifts": [[99, 0], [0, 99]]}, "grid of frame 0"),
    "rotations alone": ({"shifts": None, "rotations": np.zeros((2, 3))}, "intrinsics"),
    "initial shape": ({"shifts": None, "initial": np.zeros((2, 4))}, "initial has shape"),
    "initial rotations alone": ({"shifts": None, "initial": np.zeros((2, 3))}, "intrinsics"),
    "intrinsics shape": ({"intrinsics": np.eye(2)}, "intrinsics has shape"),
    "focal length": ({"intrinsics": np.diag([0.0, 1, 1])}, "focal"),
    "distortion alone": ({"distortion": np.zeros(5)}, "intrinsics"),
    "distortion size": ({"intrinsics": np.eye(3), "distortion": np.zeros(3)}, "coefficients"),
    "ambiguity range": ({"ambiguity_range": 0.0}, "ambiguity_range"),
    "millimetres": (
        {"distance": np.full((2, 4, 4), 1500.0), "shifts": None, "ambiguity_range": 7.5},
        "100% .* beyond 22.5, .* same unit",
    ),
    "noise": ({"noise": -1.0}, "noise"),
    "guide shape": ({"guide": np.ones((4, 4))}, "guide has shape"),
    "method": ({"options": FusionOptions(method="magic")}, "unknown"),  # type: ignore[arg-type]
    "factor zero": ({"options": FusionOptions(upsampling=0)}, "upsampling"),
    "factor fraction": ({"options": FusionOptions(upsampling=2.5)}, "upsampling"),  # type: ignore[arg-type]
    "regularization": ({"options": FusionOptions(regularization=-1.0)}, "regularization"),
    "regularization text": ({"options": FusionOptions(regularization="much")}, "regularization"),  # type: ignore[arg-type]
    "tolerance": ({"options": FusionOptions(tolerance=float("nan"))}, "tolerance"),
    "iterations": ({"options": FusionOptions(max_iterations=0)}, "max_iterations"),
    "threshold": ({"options": FusionOptions(amplitude_threshold=-1.0)}, "amplitude_threshold"),
    "fill": ({"options": FusionOptions(fill=float("inf"))}, "fill"),
    "neighbourhood": ({"options": FusionOptions(neighbourhood=((0, 1),))}, "neighbourhood"),
    "far neighbourhood": (
        {"options": FusionOptions(neighbourhood=((0, 1), (1, 0), (3, 3)))},
        "neighbourhood",
    ),
    "footprint": ({"options": FusionOptions(footprint=Footprint(side=0.0))}, "side"),
    "phasor alone": ({"options": FusionOptions(method="phasor")}, "ambiguity_range"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case: str) -> None:
    change, words = REFUSED[case]
    arguments = {
        "distance": np.ones((2, 4, 4)),
        "shifts": np.zeros((2, 2)),
        "options": nearest_options(),
        **change,
    }
    frames, light = arguments.pop("distance"), arguments.pop("amplitude", None)
    with pytest.raises(FusionInputError, match=words):
        fuse(frames, light, **arguments)
