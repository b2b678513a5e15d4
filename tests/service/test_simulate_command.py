"""`lidarboost simulate`, and the recordings in the repository that it made."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.calibration import sr3000_calibration
from drivers.recording import open_recording
from drivers.simulated import SimulatedCamera
from service.calibration.board import Board, find_board
from service.calibration.intrinsics import distinct_views
from service.cli import app

RECORDINGS = Path(__file__).parents[2] / "recordings"


def run(*words):
    return CliRunner().invoke(app, ["simulate", *map(str, words)])


def truth_of(recording):
    with np.load(io.BytesIO(recording.attachment("truth.npz"))) as stored:
        return dict(stored)


def phases(frames):
    """(N, 2) where each frame looks, in pixels of the first, (dy, dx)."""
    angles = np.array([(frame.tilt, frame.pan) for frame in frames])
    return -200.0 * np.tan(angles)


def test_it_records_the_scan_with_everything_around_it(tmp_path):
    path = tmp_path / "step.mcap"
    result = run(
        "--scene", "step", "-n", 3, "--span", 6, "--bursts", 2, "--integration-time", 10, "--seed", 4,
        "--json", "-o", path,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert (said["frames"], said["bursts"], said["scene"]) == (6, 2, "step")
    assert said["size"] == path.stat().st_size
    recording = open_recording(path)
    frames = list(recording.frames())
    assert [(frame.burst, frame.pose) for frame in frames] == [(b, p) for b in range(2) for p in range(3)]
    assert [frame.sequence for frame in frames] == list(range(6))
    assert {frame.integration_time for frame in frames} == {0.010}
    assert (frames[0].pan, frames[0].tilt) == (0.0, 0.0)
    assert np.ptp(phases(frames), axis=0).max() <= 6.0
    assert recording.calibration.noise.coefficient == pytest.approx(30.0)
    assert 'scene = "step"' in recording.configuration
    assert recording.attachment("thumbnail.png").startswith(b"\x89PNG")
    assert recording.metadata["camera_model"] == "simulated SR3000, scene step"
    assert (recording.metadata["source"], recording.planned) == ("simulation", 3)
    truth = truth_of(recording)
    assert {name: image.dtype for name, image in truth.items()} == dict.fromkeys(
        ("distance", "depth", "amplitude"), np.dtype(np.float32)
    )
    assert truth["distance"].shape == (576, 704)
    np.testing.assert_allclose(truth["depth"][:, :352], 2.0, atol=1e-4)
    np.testing.assert_array_equal(recording.truth, truth["distance"])


def test_the_same_command_gives_the_same_frames(tmp_path):
    first, again, other = (tmp_path / name for name in ("a.mcap", "b.mcap", "c.mcap"))
    for path, seed in ((first, 1), (again, 1), (other, 2)):
        assert run("--scene", "plane", "-n", 2, "--seed", seed, "-o", path).exit_code == 0
    a, b, c = (list(open_recording(path).frames()) for path in (first, again, other))
    for one, two, three in zip(a, b, c, strict=True):
        assert (one.timestamp, one.pan, one.tilt) == (two.timestamp, two.pan, two.tilt)
        np.testing.assert_array_equal(one.counts, two.counts)
        np.testing.assert_array_equal(one.amplitude, two.amplitude)
        assert (one.counts != three.counts).mean() > 0.9


def test_progress_is_said_on_standard_error_alone(tmp_path):
    result = run("--scene", "plane", "-n", 2, "-o", tmp_path / "p.mcap")
    assert "2 of 2 frames" in result.stderr
    assert "scene plane" in result.stdout
    assert "of 2 frames" not in result.stdout


def test_a_recording_that_exists_is_not_replaced_without_being_asked(tmp_path):
    path = tmp_path / "kept.mcap"
    path.write_bytes(b"precious")
    assert run("-o", path).exit_code == 1
    assert path.read_bytes() == b"precious"
    assert run("--scene", "plane", "-n", 1, "--force", "-o", path).exit_code == 0
    assert open_recording(path).frame_count == 1


@pytest.mark.parametrize(
    ("words", "status"),
    [(("--scene", "moon"), 2), (("-n", 0), 2), (("--span", 100), 2), (("--integration-time", 0), 2)],
)
def test_what_cannot_be_simulated_leaves_nothing_behind(tmp_path, words, status):
    assert run(*words, "-o", tmp_path / "x.mcap").exit_code == status
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path):
    result = run("--scene", "plane", "-n", 1, "-o", tmp_path / "missing" / "x.mcap")
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].startswith("error: ")
    assert "missing" in result.stderr.splitlines()[-1]


def test_a_simulation_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError("the renderer fell over")

    monkeypatch.setattr(SimulatedCamera, "truth", fail)
    assert run("--scene", "plane", "-n", 1, "-o", tmp_path / "x.mcap").exit_code == 1
    assert list(tmp_path.iterdir()) == []


def test_a_torn_simulation_says_what_its_only_burst_lacks(tmp_path):
    path = tmp_path / "x.mcap"
    assert run("--scene", "plane", "-n", 9, "-o", path).exit_code == 0
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    recording = open_recording(path)
    assert 1 < recording.frame_count < 9
    assert f"burst 0 has {recording.frame_count} of 9 frames" in str(recording.damage)


@pytest.mark.parametrize(("name", "span"), [("wedges", 15.0), ("objects", 30.0)])
def test_the_bundled_recordings_are_as_promised(name, span):
    path = RECORDINGS / f"{name}.mcap"
    assert path.stat().st_size < 3_000_000
    recording = open_recording(path)
    frames = list(recording.frames())
    assert recording.damage is None
    assert len(frames) == 15
    assert {frame.shape for frame in frames} == {(144, 176)}
    assert {frame.integration_time for frame in frames} == {0.030}
    assert {frame.burst for frame in frames} == {0}
    where = phases(frames)
    assert where[0].tolist() == [0.0, 0.0]
    assert (np.abs(where) <= span / 2).all()
    assert (np.ptp(where, axis=0) > 0.6 * span).all()
    # All sixteen sub-pixel cells but one or two are hit, and not by poses on the cells' own raster.
    cells = {tuple(cell) for cell in np.floor((where + 0.5) % 1.0 * 4).astype(int).tolist()}
    assert len(cells) >= 12
    assert np.mean(np.abs(where * 4 - np.round(where * 4)) > 0.1) > 0.5
    assert recording.calibration.mount.lever_arm == (0.0, 0.0, 0.0)
    assert f'scene = "{name}"' in recording.configuration
    truth = truth_of(recording)
    assert truth["distance"].shape == (576, 704)
    assert 1.8 < truth["distance"].min() < truth["distance"].max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "span"), [("wedges", 15.0), ("objects", 30.0)])
def test_the_bundled_recordings_are_what_the_simulator_makes_today(tmp_path, name, span):
    """Up to the last digit of sines, which may differ between processors, and so one count here and there."""
    path = tmp_path / f"{name}.mcap"
    assert run("--scene", name, "-n", 15, "--span", span, "-o", path).exit_code == 0
    made, bundled = open_recording(path), open_recording(RECORDINGS / f"{name}.mcap")
    for new, old in zip(made.frames(), bundled.frames(), strict=True):
        assert (new.timestamp, new.sequence, new.pan, new.tilt) == (
            old.timestamp,
            old.sequence,
            old.pan,
            old.tilt,
        )
        for image in ("counts", "amplitude"):
            off = np.abs(getattr(new, image).astype(int) - getattr(old, image).astype(int))
            assert np.minimum(off, 65536 - off).max() <= 1
    np.testing.assert_allclose(made.truth, bundled.truth, atol=1e-4)


def test_a_board_is_shown_in_many_poses(tmp_path):
    path = tmp_path / "board.mcap"
    result = run("--scene", "board", "--views", 3, "--board", "8x5", "--square", 40, "-o", path)
    assert result.exit_code == 0, result.output
    frames = list(open_recording(path).frames())
    assert [(frame.burst, frame.pose) for frame in frames] == [(0, 0), (1, 0), (2, 0)]
    assert {(frame.pan, frame.tilt) for frame in frames} == {(0.0, 0.0)}
    seen = [find_board(frame.amplitude, Board(8, 5, 0.04)) for frame in frames]
    assert all(sighting is not None for sighting in seen)
    assert len(distinct_views(seen, 176)) == 3


def test_views_of_what_is_no_board_are_refused(tmp_path):
    result = run("--scene", "wedges", "--views", 3, "-o", tmp_path / "x.mcap")
    assert result.exit_code == 2
    assert "expected --scene board, not wedges" in result.output


def test_a_wall_stands_where_it_is_put(tmp_path):
    path = tmp_path / "wall.mcap"
    result = run("--scene", "plane", "--away", 1.2, "--span", 0, "-n", 2, "--no-noise", "-o", path)
    assert result.exit_code == 0, result.output
    frames = list(open_recording(path).frames())
    assert {(frame.pan, frame.tilt) for frame in frames} == {(0.0, 0.0)}
    assert frames[0].distance[72, 88] == pytest.approx(1.2, abs=1e-3)


def test_the_mount_is_given_once(tmp_path):
    true = tmp_path / "true.toml"
    sr3000_calibration().save(true)
    result = run("--camera", true, "--lever-arm", 0, 0, 0.1, "-o", tmp_path / "x.mcap")
    assert result.exit_code != 0
    assert "lever_arm: the calibration file says that" in result.output
    result = run("--lever-arm", "nan", 0, 0, "-o", tmp_path / "x.mcap")
    assert "lever_arm.0: Input should be" in result.output
    assert "internal error" not in result.output
    assert not (tmp_path / "x.mcap").exists()
