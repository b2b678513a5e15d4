"""Cameras without modulation and without amplitude: every consumer of frames copes."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from depth_cameras import KNOWN, SHAPE, depth_frames
from typer.testing import CliRunner

from drivers.calibration import Calibration, Corrections, CyclicTerm, Mount, NoiseLaw
from drivers.errors import RecordingError
from drivers.recording import RecordingWriter, open_recording
from service.calibration.noise import calibrate_noise
from service.calibration.still import reduce_still
from service.cli import app
from service.config.sections import FusionSection
from service.errors import CalibrationError
from service.fusion.fuse import fuse_burst, stack
from service.fusion.job import FrameJob
from service.fusion.streams import Stream
from service.jobs.export import clouds, frame_arrays
from service.jobs.quick_look import draw_frames
from service.messages.burst import Burst
from service.messages.encoding import fused_messages
from service.messages.viewing import points_message
from service.planning.check import exposure_of
from service.sinks.drawing import write_preview

QUICK = FusionSection(method="shift-and-add", upsampling=2, register_poses=False)


def burst_of(frames, calibration=KNOWN):
    return Burst(0, tuple(frames), calibration, len(frames))


def recorded(path, frames):
    with RecordingWriter(path) as writer:
        writer.write_calibration(KNOWN, frames[0].timestamp)
        for frame in frames:
            writer.write_frame(frame, Mount())
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "method"),
    [
        ({}, "area"),
        ({"scaled": True}, "area"),
        ({"amplitude": True}, "area"),
        ({"amplitude": True, "frequency": 20e6}, "phasor"),
    ],
)
def test_the_method_follows_from_what_the_camera_gives(changes, method):
    result = fuse_burst(burst_of(depth_frames(**changes)), FusionSection(upsampling=2, register_poses=False))
    assert result.report.method == method
    assert np.isfinite(result.depth).mean() > 0.9
    assert (result.amplitude is not None) == (method == "phasor")


def test_maps_messages_and_pictures_are_made_without_amplitude(tmp_path):
    result = fuse_burst(burst_of(depth_frames()), QUICK)
    topics = [message.topic for message in fused_messages(result)]
    assert "fused/depth" in topics
    assert "fused/amplitude" not in topics
    assert points_message(result).payload
    write_preview(tmp_path / "x.png", result)
    assert cv2.imread(str(tmp_path / "x.png")).shape[2] == 3


def test_a_law_of_noise_over_amplitude_says_nothing_of_frames_without_amplitude():
    lawful = KNOWN.model_copy(update={"noise": NoiseLaw(coefficient=30.0)})
    settings = FusionSection(upsampling=2, register_poses=False)
    frames, maps = depth_frames(), {}
    for name, calibration in (("law", lawful), ("none", KNOWN)):
        job = FrameJob(frames[0], calibration, settings, 3, 0, 0)
        maps[name] = fuse_burst(burst_of(frames, calibration), settings), Stream(job).push(job)
    for with_law, without in zip(maps["law"], maps["none"], strict=True):
        assert with_law.report.regularization == without.report.regularization
        np.testing.assert_array_equal(with_law.deviation, without.deviation)


def test_a_stream_gives_maps_without_amplitude():
    frames = depth_frames()
    jobs = [FrameJob(frame, KNOWN, QUICK, 3, 0, number) for number, frame in enumerate(frames)]
    stream = Stream(jobs[0])
    for job in jobs:
        result = stream.push(job)
    assert result.depth.shape == (2 * SHAPE[0], 2 * SHAPE[1])


def test_a_stream_that_pans_keeps_the_grid_that_it_moved_to():
    angles = (0.0, 0.3, 0.7, 0.75, 0.8)
    frames = [replace(frame, pan=angle) for frame, angle in zip(depth_frames(5), angles, strict=True)]
    stream = Stream(FrameJob(frames[0], KNOWN, QUICK, 3, 0, 0))
    reports = [
        stream.push(FrameJob(frame, KNOWN, QUICK, 3, 0, number)).report for number, frame in enumerate(frames)
    ]
    assert [["grid moved" in note for note in report.notes] for report in reports] == [[], [], [True], [], []]
    turned = [report.shifts[-1][1] for report in reports[2:]]
    expected = [45 * np.tan(angle - 0.7) for angle in angles[2:]]
    np.testing.assert_allclose(np.abs(turned), expected, atol=0.01)


def test_phasor_that_is_asked_for_says_what_it_lacks():
    from solver.errors import FusionError

    with pytest.raises(FusionError, match="needs amplitude and ambiguity_range"):
        fuse_burst(burst_of(depth_frames()), QUICK.model_copy(update={"method": "phasor"}))


def test_frames_with_and_without_amplitude_make_no_burst():
    mixed = [*depth_frames(2), *depth_frames(2, amplitude=True)]
    with pytest.raises(RecordingError, match="with amplitude and without"):
        burst_of(mixed)


def test_a_cyclic_correction_needs_a_range():
    cyclic = Corrections(cyclic=(CyclicTerm(amplitude=0.01, harmonic=4, phase=0.0),))
    with pytest.raises(RecordingError, match="cyclic error"):
        burst_of(depth_frames(2), KNOWN.model_copy(update={"corrections": cyclic}))


def test_a_constant_correction_does_not_wrap():
    known = KNOWN.model_copy(update={"corrections": Corrections(constant=0.5)})
    frames = depth_frames(1)
    distance, amplitude = stack(frames, known)
    assert amplitude is None
    np.testing.assert_allclose(distance[0], frames[0].distance - 0.5, atol=1e-6)
    beyond = KNOWN.model_copy(update={"corrections": Corrections(constant=3.0)})
    assert np.isnan(stack(frames, beyond)[0]).all()


def test_exposure_and_quick_look_know_of_no_light(tmp_path):
    found = exposure_of(depth_frames(3))
    assert found.saturated == 0
    assert found.dark == pytest.approx(3 / (SHAPE[0] * SHAPE[1]))
    assert sum(found.histogram) == 0
    assert found.noise is not None
    draw_frames(tmp_path / "a.png", depth_frames(1))
    draw_frames(tmp_path / "b.png", [depth_frames(1)[0]] * 2)


def test_noise_cannot_be_calibrated_without_amplitude():
    still = reduce_still([depth_frames(1)[0]] * 2)
    assert still.amplitude is None
    np.testing.assert_allclose(still.distance, depth_frames(1)[0].distance, atol=1e-6)
    with pytest.raises(CalibrationError, match="gives no amplitude"):
        calibrate_noise([[depth_frames(1)[0]] * 2])


def test_arrays_and_points_of_a_recording(tmp_path):
    frames = depth_frames(scaled=True)
    recording = open_recording(recorded(tmp_path / "x.mcap", frames))
    arrays = frame_arrays(recording)
    assert "amplitude" not in arrays
    np.testing.assert_array_equal(arrays["metres_per_count"], 1e-3)
    assert np.isnan(arrays["ambiguity_range"]).all()
    np.testing.assert_array_equal(arrays["counts"][0], frames[0].counts)
    cloud = next(clouds(recording))
    assert cloud.dtype.names == ("x", "y", "z")


def test_info_tells_what_is_not_there(tmp_path):
    path = recorded(tmp_path / "x.mcap", depth_frames())
    said = CliRunner().invoke(app, ["info", str(path)])
    assert said.exit_code == 0
    assert "modulation none known, so distances do not wrap; amplitude none" in said.stdout
    frames = json.loads(CliRunner().invoke(app, ["info", str(path), "--json"]).stdout)["frames"]
    assert frames["ambiguity_ranges"] == [None]


def test_a_folder_of_pictures_is_imported_and_played(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for frame in depth_frames(4, scaled=True):
        cv2.imwrite(str(folder / f"{frame.sequence}.png"), frame.counts)
    lens = tmp_path / "lens.toml"
    lens.write_text(KNOWN.to_toml())
    words = ["import", folder, "--kind", "depth", "--scale", "0.001", "--calibration", lens]
    output = tmp_path / "x.mcap"
    done = CliRunner().invoke(app, [str(word) for word in [*words, "--rate", 30, "-o", output]])
    assert done.exit_code == 0, done.stderr
    assert "4 frames of 48 × 36 pixels in 1 burst" in done.stdout
    (first, *_) = open_recording(output).frames()
    assert first.distance[17, 24] == pytest.approx(depth_frames(1, scaled=True)[0].distance[17, 24], rel=1e-3)
    assert isinstance(open_recording(output).calibration, Calibration)
    untold = CliRunner().invoke(app, ["import", str(folder), "-o", str(tmp_path / "y.mcap")])
    assert untold.exit_code == 1
    assert len(untold.stderr.strip().splitlines()) == 1
