"""Streaming: the window, its grid, and agreement with `fuse` on the same frames."""

import numpy as np
import pytest
from made_streams import COLUMNS, ROWS, long_stream

from solver import FusionInputError, FusionOptions, SlidingFusion, fuse
from solver.preparation.prepare import exchange
from solver.preparation.problem import Problem

SHIFTS = np.array([[0, 0], [0.25, 0.5], [-0.5, 0.25], [0.5, -0.25], [-0.25, -0.4], [0.1, 0.6]])


def frames(noise: float = 0.005) -> np.ndarray:
    """A tilted wall with a block, the block's edges moving with the shifts."""
    rows, columns = np.mgrid[0:ROWS, 0:COLUMNS]
    draw = np.random.default_rng(3).normal(size=(len(SHIFTS), ROWS, COLUMNS))
    stack = []
    for (dy, dx), grain in zip(SHIFTS, draw, strict=True):
        y, x = rows + dy, columns + dx
        block = np.clip(y - 5, 0, 1) * np.clip(14 - y, 0, 1) * np.clip(x - 6, 0, 1) * np.clip(16 - x, 0, 1)
        stack.append(2.0 + 0.01 * x - 0.5 * block + noise * grain)
    return np.array(stack, np.float32)


@pytest.mark.parametrize("method", ["lidarboost", "area"])
def test_a_window_gives_what_fuse_gives(method: str) -> None:
    stack = frames()
    options = FusionOptions(method=method, regularization=0.02)  # type: ignore[arg-type]
    sliding = SlidingFusion(options, window=4)
    for frame, shift in zip(stack, SHIFTS, strict=True):
        streamed = sliding.push(frame, shift=shift)
    assert streamed.report.used == (2, 3, 4, 5)
    whole = fuse(stack[2:], shifts=SHIFTS[2:], options=options)
    np.testing.assert_allclose(streamed.shifts, SHIFTS[2:])
    # Compared with noise of 5 mm. Near the border few samples say where a transition lies, and its place
    # depends on the start.
    difference = streamed.distance - whole.distance
    assert np.sqrt(np.nanmean(difference**2)) < 0.005
    assert np.sqrt(np.nanmean(difference[12:-12, 12:-12] ** 2)) < 0.0025
    if method == "lidarboost":  # one convex problem, whatever the start
        assert streamed.report.objective == pytest.approx(whole.report.objective, rel=5e-3)


@pytest.mark.parametrize("method", ["lidarboost", "area", "phasor"])
def test_a_window_whose_frames_are_exchanged_gives_what_fuse_gives(method: str) -> None:
    # A window of 10 is prepared with frame 9 and again with frame 30; those between only change places.
    distance, amplitude, shifts = long_stream(34)
    options = FusionOptions(method=method)  # type: ignore[arg-type]
    # With a range `area` takes them for mixed phasors, and learns from each window how these mix.
    known = {} if method == "area" else {"ambiguity_range": 7.5}
    if method == "lidarboost":  # whose objective goes by λ, and that by what each window tells of the noise
        known["noise"] = 5.0
    sliding = SlidingFusion(options, window=10, **known)
    for number, shift in enumerate(shifts):
        streamed = sliding.push(distance[number], amplitude[number], shift=shift)
        if number < 24:
            continue
        window = slice(number - 9, number + 1)
        whole = fuse(distance[window], amplitude[window], shifts=shifts[window], options=options, **known)
        assert streamed.report.used == tuple(range(number - 9, number + 1))
        # Noise of 5 mm; a pixel on the block's edge may go to either side.
        difference = np.abs(streamed.distance - whole.distance)[8:-8, 8:-8]
        assert difference.mean() < 0.001
        assert np.percentile(difference, 99) < 0.006
        spread = np.abs(streamed.deviation / whole.deviation - 1)
        # What `phasor` tells of its bias is read off a few windows of the map, so it scatters.
        if method == "phasor":
            assert np.percentile(spread, 90) < 0.45
        assert np.percentile(spread, 99) < (2 if method == "phasor" else 0.3)
        if method == "lidarboost":  # one convex problem, whatever the start
            assert streamed.report.objective == pytest.approx(whole.report.objective, rel=0.06)


@pytest.mark.parametrize("method", ["lidarboost", "area", "phasor"])
def test_a_dark_frame_in_a_full_window_changes_little(method: str) -> None:
    distance, amplitude, shifts = long_stream(12)
    amplitude[10] = 0
    options = FusionOptions(method=method)  # type: ignore[arg-type]
    known = {"ambiguity_range": 7.5, "noise": 5.0}
    sliding = SlidingFusion(options, window=8, **known)
    fused = [
        sliding.push(*frame, shift=shift) for *frame, shift in zip(distance, amplitude, shifts, strict=True)
    ]
    assert fused[10].report.used == (3, 4, 5, 6, 7, 8, 9, 10)
    for number in (10, 11):
        window = slice(number - 7, number + 1)
        whole = fuse(distance[window], amplitude[window], shifts=shifts[window], options=options, **known)
        difference = np.abs(fused[number].distance - whole.distance)[8:-8, 8:-8]
        assert np.median(difference) < 0.003  # noise of 5 mm
        assert np.percentile(difference, 95) < 0.03  # `fuse` learns its weights from the darker sum


def test_a_full_window_survives_a_frame_that_cannot_be_fused(monkeypatch: pytest.MonkeyPatch) -> None:
    distance, amplitude, shifts = long_stream(12)
    sliding = SlidingFusion(FusionOptions(method="area"), window=8, ambiguity_range=7.5)
    for frame, light, shift in zip(distance[:10], amplitude, shifts, strict=False):
        sliding.push(frame, light, shift=shift)
    with monkeypatch.context() as patch:
        patch.setattr("solver.optimisation.reweighting.minimise", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            sliding.push(distance[10], amplitude[10], shift=shifts[10])
    fused = sliding.push(distance[11], amplitude[11], shift=shifts[11])
    options = FusionOptions(method="area")
    whole = fuse(distance[4:], amplitude[4:], shifts=shifts[4:], options=options, ambiguity_range=7.5)
    assert np.sqrt(np.nanmean((fused.distance - whole.distance)[8:-8, 8:-8] ** 2)) < 0.004


def _interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_a_full_window_survives_an_exchange_that_got_half_way(monkeypatch: pytest.MonkeyPatch) -> None:
    distance, amplitude, shifts = long_stream(12)
    options, known = FusionOptions(method="area"), {"ambiguity_range": 7.5, "noise": 5.0}
    sliding = SlidingFusion(options, window=8, **known)
    for frame, light, shift in zip(distance[:10], amplitude, shifts, strict=False):
        sliding.push(frame, light, shift=shift)

    def half_way(problem: Problem, slot: int, *frame: np.ndarray) -> bool:
        exchange(problem, slot, *frame)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("solver.stream.window.exchange", half_way)
        with pytest.raises(KeyboardInterrupt):
            sliding.push(distance[10], amplitude[10], shift=shifts[10])
    fused = sliding.push(distance[11], amplitude[11], shift=shifts[11])
    whole = fuse(distance[4:], amplitude[4:], shifts=shifts[4:], options=options, **known)
    np.testing.assert_allclose(fused.distance, whole.distance, atol=1e-5)


@pytest.mark.parametrize("method", ["nearest", "shift-and-add", "mrf", "lidarboost", "area", "phasor"])
def test_the_callers_memory_and_what_was_given_out_are_left_alone(method: str) -> None:
    distance, amplitude, shifts = long_stream(12)
    options = FusionOptions(method=method)  # type: ignore[arg-type]
    streams = [SlidingFusion(options, window=8, ambiguity_range=7.5) for _ in range(2)]
    given, kept = [], []
    frame, light = np.empty_like(distance[0]), np.empty_like(amplitude[0])
    for number, shift in enumerate(shifts):
        before = distance[number].copy()
        given.append(streams[0].push(distance[number], amplitude[number], shift=shift))
        np.testing.assert_array_equal(distance[number], before)
        kept.append((given[-1].distance.copy(), given[-1].deviation.copy(), given[-1].shifts.copy()))
        # A camera that writes each frame to the same place.
        frame[:], light[:] = distance[number], amplitude[number]
        again = streams[1].push(frame, light, shift=shift)
        np.testing.assert_array_equal(again.distance, given[-1].distance)
        np.testing.assert_array_equal(again.deviation, given[-1].deviation)
    for fused, images in zip(given, kept, strict=True):
        for found, image in zip((fused.distance, fused.deviation, fused.shifts), images, strict=True):
            np.testing.assert_array_equal(found, image)


@pytest.mark.parametrize("method", ["lidarboost", "area", "phasor"])
def test_a_constant_scene_without_noise_stays_constant(method: str) -> None:
    _, amplitude, shifts = long_stream(12)
    sliding = SlidingFusion(FusionOptions(method=method), window=8, ambiguity_range=7.5)  # type: ignore[arg-type]
    for light, shift in zip(amplitude, shifts, strict=True):
        fused = sliding.push(np.full((ROWS, COLUMNS), 2, np.float32), light, shift=shift)
        np.testing.assert_allclose(fused.distance, 2, atol=1e-5)


def test_warm_starts_need_fewer_iterations() -> None:
    options = FusionOptions(method="lidarboost", regularization=0.02)
    sliding = SlidingFusion(options, window=6)
    counts = [
        sliding.push(f, shift=s).report.iterations
        for f, s in zip(np.tile(frames(), (3, 1, 1)), np.tile(SHIFTS, (3, 1)), strict=True)
    ]
    cold = fuse(frames(), shifts=SHIFTS, options=options).report.iterations
    assert np.mean(counts[8:]) < 0.7 * cold


def test_phasor_streams() -> None:
    stack = frames()
    sliding = SlidingFusion(window=3, ambiguity_range=7.5)
    for frame, shift in zip(stack, SHIFTS, strict=True):
        fused = sliding.push(frame, np.full_like(frame, 1000.0), shift=shift)
    assert fused.report.method == "phasor"
    assert fused.amplitude is not None
    assert abs(float(np.nanmedian(fused.distance)) - 2.1) < 0.1


def test_the_grid_moves_when_the_view_has() -> None:
    stack = frames()
    sliding = SlidingFusion(FusionOptions(method="lidarboost"), window=3)
    assert sliding.push(stack[0], shift=[0, 0]).report.notes == ()
    assert sliding.push(stack[1], shift=[0, 11]).report.notes == ()
    moved = sliding.push(stack[2], shift=[0, 13])
    assert len(moved.report.notes) == 1
    assert "grid moved" in moved.report.notes[0]
    np.testing.assert_allclose(moved.shifts, [[0, -13], [0, -2], [0, 0]])
    assert sliding.push(stack[3], shift=[0, 13.5]).report.notes == ()


def test_reset_starts_anew() -> None:
    sliding = SlidingFusion(FusionOptions(method="lidarboost"), window=3)
    sliding.push(frames()[0], shift=[0, 0])
    sliding.reset()
    fused = sliding.push(frames()[1], shift=[3, 3])
    assert fused.report.used == (0,)
    np.testing.assert_allclose(fused.shifts, [[0, 0]])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"distance": np.ones((ROWS, COLUMNS + 1))}, "expected that of the frames before"),
        ({"amplitude": np.ones((ROWS, COLUMNS))}, "every frame"),
        ({"distance": np.ones((2, ROWS, COLUMNS))}, "N, H, W"),
        ({"shift": [0, np.nan]}, "finite"),
        ({"shift": [0, 0, 0]}, "shape"),
        ({"rotation": [0, 0, 0]}, "shift"),
        ({"shift": [0, 0], "rotation": [0, 0, 0]}, "at most one"),
    ],
)
def test_refuses(arguments: dict[str, object], words: str) -> None:
    sliding = SlidingFusion(FusionOptions(method="lidarboost"), window=3)
    sliding.push(frames()[0], shift=[0, 0])
    given = {"distance": frames()[1], **arguments}
    with pytest.raises(FusionInputError, match=words):
        sliding.push(**given)  # type: ignore[arg-type]
    assert sliding.push(frames()[1], shift=[0, 0]).report.used == (0, 1)


def test_refuses_a_window_without_frames() -> None:
    with pytest.raises(FusionInputError, match="window"):
        SlidingFusion(window=0)


@pytest.mark.parametrize(("method", "most"), [("lidarboost", 6), ("area", 24)])
def test_a_stream_that_is_prepared_anew_is_not_run_to_its_end(method: str, most: int) -> None:
    distance, amplitude, shifts = long_stream(34)
    distance += np.random.default_rng(6).normal(0, 0.1, distance.shape).astype(np.float32)
    sliding = SlidingFusion(FusionOptions(method=method), window=10, noise=100.0)  # type: ignore[arg-type]
    taken = [
        sliding.push(frame, light, shift=shift).report.iterations
        for frame, light, shift in zip(distance, amplitude, shifts, strict=True)
    ]
    assert max(taken[12:]) <= most < 0.7 * taken[9]
