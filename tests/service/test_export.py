"""`export`: arrays equal to what was recorded, clouds where the camera saw the points."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers import Frame, sr3000_calibration, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message, image_message
from drivers.recording import Recording, RecordingWriter
from service.cli import app

START = 1_700_000_000_000_000_000
SHAPE = (144, 176)
REASON = np.zeros((36, 44), np.uint8)
REASON[0, :5], REASON[1] = 2, 1


def lidarboost(*arguments):
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.stderr


def flat_frame(number):
    """2.5 m everywhere but for 10 rejected pixels."""
    counts = np.full(SHAPE, 32_768, np.uint16)
    counts.flat[:10] = 0
    amplitude = np.full(SHAPE, 1000 + number, np.uint16)
    burst = None if number else 0
    return Frame(counts, amplitude, START + number, number, 0.1, 0.2, None, 30e6, 5.0, burst=burst)


def depth_of(number):
    depth = np.full((36, 44), 2.0 + number, np.float32)
    depth[0, :5] = np.nan
    return depth


@pytest.fixture
def frames(tmp_path):
    path = tmp_path / "frames.mcap"
    with RecordingWriter(path) as writer:
        writer.write_calibration(sr4000_calibration(), START)
        for number in range(3):
            writer.write_frame(flat_frame(number), Mount())
    return path


@pytest.fixture
def maps(tmp_path):
    path = tmp_path / "fused.mcap"
    small = sr3000_calibration().model_copy(update={"width": 44, "height": 36})
    with RecordingWriter(path) as writer:
        for number in range(2):
            at = START + number
            writer.write(calibration_message(small, at, "fused/calibration", number), at)
            depth = depth_of(number)
            for topic, image in (("fused/depth", depth), ("fused/deviation", depth / 100)):
                writer.write(image_message(topic, image, "32FC1", "camera", at, number), at)
            writer.write(image_message("fused/reason", REASON, "8UC1", "camera", at, number), at)
    return path


def read_ply(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    points = np.frombuffer(body, "<f4").reshape(-1, len(names))
    assert f"element vertex {len(points)}" in lines
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    return {name: points[:, number] for number, name in enumerate(names)}


def test_frames_become_arrays(frames, tmp_path):
    status, said, _ = lidarboost("export", frames, "-o", tmp_path / "x.npz")
    assert (status, said.strip()) == (0, f"{tmp_path / 'x.npz'}: 3 frames, 0 fused maps")
    with np.load(tmp_path / "x.npz") as arrays:
        np.testing.assert_array_equal(arrays["counts"][2], flat_frame(2).counts)
        np.testing.assert_array_equal(arrays["distance"][1], flat_frame(1).distance)
        assert arrays["timestamp"].tolist() == [START, START + 1, START + 2]
        assert arrays["burst"].tolist() == [0, -1, -1]
        assert np.isnan(arrays["integration_time"]).all()
        np.testing.assert_array_equal(arrays["intrinsics"], sr4000_calibration().intrinsics.matrix)
        assert tuple(arrays["distortion"]) == sr4000_calibration().distortion


def test_a_frame_becomes_points_on_its_sphere(frames, tmp_path):
    status, said, _ = lidarboost("export", frames, "-o", tmp_path / "x.ply", "--number", 2)
    assert (status, said.strip()) == (0, f"{tmp_path / 'x.ply'}: {144 * 176 - 10} points")
    points = read_ply(tmp_path / "x.ply")
    np.testing.assert_allclose(np.hypot(np.hypot(points["x"], points["y"]), points["z"]), 2.5, atol=1e-5)
    assert points["x"].min() < -0.8 < 0.8 < points["x"].max()
    assert points["z"].min() > 2
    assert set(points["amplitude"]) == {1002}


def test_maps_become_arrays_and_points(maps, tmp_path):
    assert lidarboost("export", maps, "-o", tmp_path / "x.npz")[0] == 0
    with np.load(tmp_path / "x.npz") as arrays:
        np.testing.assert_array_equal(arrays["fused_depth"], [depth_of(0), depth_of(1)])
        assert arrays["fused_timestamp"].tolist() == [START, START + 1]
        assert "fused_amplitude" not in arrays
        np.testing.assert_array_equal(arrays["fused_reason"], [REASON, REASON])
    status, said, _ = lidarboost("export", maps, "-o", tmp_path / "x.ply", "--all")
    assert (status, said.count("\n")) == (0, 2)
    for number in range(2):
        points = read_ply(tmp_path / f"x-{number:04d}.ply")
        assert len(points["x"]) == 36 * 44 - 5
        np.testing.assert_allclose(points["z"], 2.0 + number, rtol=1e-6)
        np.testing.assert_allclose(points["deviation"], (2.0 + number) / 100, rtol=1e-6)
        assert points["reason"].sum() == 44
    # f = 200 px and the centre at column 87.5: the last column lies left of the axis
    np.testing.assert_allclose(points["x"].max(), 3.0 * (43 - 87.5) / 200, rtol=1e-5)


def test_one_frame_or_map_becomes_arrays(frames, maps, tmp_path):
    for words, number in ((["--number", 1], 1), (["--latest"], 2)):
        status, said, _ = lidarboost("export", frames, "-o", tmp_path / f"{number}.npz", *words)
        assert (status, said.strip()) == (0, f"{tmp_path / f'{number}.npz'}: 1 frames, 0 fused maps")
        with np.load(tmp_path / f"{number}.npz") as arrays:
            assert arrays["sequence"].tolist() == [number]
            np.testing.assert_array_equal(arrays["amplitude"], [flat_frame(number).amplitude])
            np.testing.assert_array_equal(arrays["intrinsics"], sr4000_calibration().intrinsics.matrix)
    with RecordingWriter(tmp_path / "both.mcap") as writer:
        writer.write_calibration(sr4000_calibration(), START)
        writer.write_frame(flat_frame(0), Mount())
        for message, at in Recording(maps).messages():
            writer.write(message, at)
    for source in (maps, tmp_path / "both.mcap"):
        for words in (["--number", 1], ["--latest"]):
            assert lidarboost("export", source, "-o", tmp_path / "x.npz", "--force", *words)[0] == 0
            with np.load(tmp_path / "x.npz") as arrays:
                assert {name for name in arrays if not name.startswith("fused_")} == set()
                assert arrays["fused_timestamp"].tolist() == [START + 1]
                np.testing.assert_array_equal(arrays["fused_depth"], [depth_of(1)])


def test_a_frame_of_a_later_burst_comes_with_its_own_intrinsics(tmp_path):
    other = sr4000_calibration()
    other = other.model_copy(update={"intrinsics": other.intrinsics.model_copy(update={"fx": 300.0})})
    with RecordingWriter(tmp_path / "two.mcap") as writer:
        for number, known in enumerate((sr4000_calibration(), other)):
            writer.write_calibration(known, START + number)
            writer.write_frame(replace(flat_frame(number), burst=number), Mount())
    assert lidarboost("export", tmp_path / "two.mcap", "-o", tmp_path / "x.npz", "--number", 1)[0] == 0
    with np.load(tmp_path / "x.npz") as arrays:
        assert (arrays["burst"].tolist(), arrays["burst_index"].tolist()) == ([1], [1])
        np.testing.assert_array_equal(arrays["intrinsics"], other.intrinsics.matrix)


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["-o", "x.obj"], 2, "expected .npz or .ply"),
        (["-o", "x.ply", "--number", 3], 1, "has no map or frame number 3"),
        (["-o", "x.npz", "--number", 3], 1, "has no map or frame number 3"),
        (["-o", "nowhere/x.ply"], 1, "cannot be written"),
    ],
)
def test_what_cannot_be_exported_is_told(frames, tmp_path, monkeypatch, arguments, status, said):
    monkeypatch.chdir(tmp_path)
    found, _, error = lidarboost("export", frames, *arguments)
    assert found == status
    assert said in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["frames.mcap"]


def test_files_are_not_replaced_unasked(frames, tmp_path):
    (tmp_path / "x.npz").write_bytes(b"precious")
    assert lidarboost("export", frames, "-o", tmp_path / "x.npz")[0] == 1
    assert (tmp_path / "x.npz").read_bytes() == b"precious"
    assert lidarboost("export", frames, "-o", tmp_path / "x.npz", "--force")[0] == 0


def test_damaged_recordings_are_exported_with_status_3(frames, tmp_path):
    content = frames.read_bytes()
    frames.write_bytes(content[: len(content) - 20])
    status, _, said = lidarboost("export", frames, "-o", tmp_path / "x.npz")
    assert (status, said.startswith("lost: ")) == (3, True)
    assert (tmp_path / "x.npz").exists()


def test_the_latest_map_is_there_for_the_asking(maps, tmp_path):
    assert lidarboost("export", maps, "-o", tmp_path / "last.ply", "--latest")[0] == 0
    assert lidarboost("export", maps, "-o", tmp_path / "second.ply", "--number", 1)[0] == 0
    assert (tmp_path / "last.ply").read_bytes() == (tmp_path / "second.ply").read_bytes()
    status, _, said = lidarboost("export", maps, "-o", tmp_path / "x.ply", "--latest", "--all")
    assert (status, "exclude each other" in said) == (2, True)
    status, _, said = lidarboost("export", maps, "-o", tmp_path / "x.npz", "--latest", "--number", 0)
    assert (status, "exclude each other" in said) == (2, True)
