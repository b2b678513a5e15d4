"""`lidarboost evaluate`: tables, pictures, true maps from files, and clear errors."""

import csv
import io
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.cli import app
from service.evaluation.truth import TruthError, load_truth
from solver.errors import FusionInputError
from tests.hostile import PROFILE, assert_one_clear_line, torn

QUICK = ("--seeds", "1", "--variance", "0.7", "--frames", "4", "--exact-shifts")


@pytest.fixture(scope="module")
def relief():
    rows, columns = np.indices((200, 200))
    hill = 120 - 40 * np.exp(-((rows - 100) ** 2 + (columns - 90) ** 2) / 2000)
    return np.where((rows > 40) & (rows < 160) & (np.abs(columns - 100) < 60), hill, 200.0)


@pytest.fixture
def command(capsys):
    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            app(["evaluate", *map(str, arguments)])
        shown = capsys.readouterr()
        return ended.value.code, shown.out, shown.err

    return run


@pytest.fixture
def file(tmp_path, relief):
    path = tmp_path / "relief.npy"
    np.save(path, relief)
    return path


def test_the_table_as_text_json_and_csv(command, file):
    chosen = ("--truth", file, "--method", "nearest", "--method", "mrf", *QUICK)
    status, text, _ = command(*chosen)
    assert status == 0
    lines = text.splitlines()
    assert lines[0].split()[:2] == ["variance", "method"]
    assert [line.split()[1] for line in lines[1:]] == ["nearest", "mrf"]
    rows = json.loads(command(*chosen, "--format", "json")[1])
    assert [row["method"] for row in rows] == ["nearest", "mrf"]
    assert rows[0]["relative"] == pytest.approx(1)
    table = list(csv.DictReader(io.StringIO(command(*chosen, "--format", "csv")[1])))
    assert float(table[1]["mse"]) == pytest.approx(rows[1]["mse"])


def test_pictures_and_tables_are_saved(command, file, tmp_path):
    out = tmp_path / "out"
    strengths = ("--regularization", "0.1", "--regularization", "1")
    status, _, _ = command("--truth", file, "--method", "mrf", *strengths, *QUICK, "--output", out)
    assert status == 0
    names = {path.name for path in out.iterdir()}
    assert names == {
        "table.txt",
        "table.json",
        "table.csv",
        "error_against_lambda.png",
        "errors_0.7.png",
        "surfaces_0.7.png",
    }
    for path in out.glob("*.png"):
        picture = cv2.imread(str(path))
        assert picture is not None
        assert picture.std() > 5


def test_ablations_show_the_cut_off(command, file, tmp_path):
    out = tmp_path / "out"
    chosen = ("--ablations", "--region", "4,4,16,16", "--method", "nearest")
    status, text, _ = command("--truth", file, *chosen, *QUICK, "--output", out)
    assert status == 0
    assert "absolute data term" in text
    assert "without amplitude threshold" in text
    red = cv2.imread(str(out / "amplitude_cutoff.png"))[..., ::-1].astype(int)
    assert ((red[..., 0] > 180) & (red[..., 1] < 60)).sum() > 100


def test_an_archive_with_a_finer_map_is_read_at_both_resolutions(tmp_path, relief):
    np.savez(tmp_path / "both.npz", truth=relief, fine=relief.repeat(2, axis=0).repeat(2, axis=1))
    truth = load_truth(tmp_path / "both.npz")
    assert truth.depth.oversampling == 2
    assert truth.depth.frame_shape(4) == (25, 25)


def test_zero_in_a_picture_is_unknown(tmp_path, relief):
    image = (relief * 10).astype(np.uint16)
    image[:20] = 0
    cv2.imwrite(str(tmp_path / "depth.png"), image)
    depth = load_truth(tmp_path / "depth.png").depth
    assert np.allclose(depth.image[:20], 182)
    assert depth.image.min() == 0


def test_a_simulated_recording_is_a_true_map_and_has_an_amplitude(tmp_path):
    with pytest.raises(SystemExit) as ended:
        app(["simulate", "--scene", "sphere", "--frames", "2", "-o", str(tmp_path / "scan.mcap")])
    assert ended.value.code == 0
    truth = load_truth(tmp_path / "scan.mcap")
    assert truth.amplitude is not None
    assert truth.depth.frame_shape(4) == (72, 88)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.npy", b"no array", "not a NumPy array"),
        ("a.npz", b"no archive", "not a NumPy archive"),
        ("a.png", b"no picture", "not a PNG"),
        ("a.tif", b"", "expected .npy"),
    ],
)
def test_files_that_hold_no_map_are_named(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TruthError, match=words):
        load_truth(tmp_path / name)


def test_archives_without_a_map_and_maps_without_relief_are_refused(tmp_path, relief):
    np.savez(tmp_path / "other.npz", height=relief)
    with pytest.raises(TruthError, match="height"):
        load_truth(tmp_path / "other.npz")
    np.savez(tmp_path / "odd.npz", truth=relief, fine=np.ones((300, 300)))
    with pytest.raises(TruthError, match="multiple"):
        load_truth(tmp_path / "odd.npz")
    np.save(tmp_path / "flat.npy", np.ones((64, 64)))
    with pytest.raises(FusionInputError, match="relief"):
        load_truth(tmp_path / "flat.npy")
    with pytest.raises(TruthError, match="does not exist"):
        load_truth(tmp_path / "absent.npy")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("--truth", "absent.npy"), 1, "does not exist"),
        (("--method", "phasor"), 2, "amplitude"),
        (("--method", "best"), 2, "expected nearest"),
        (("--region", "1,2,3"), 2, "TOP,LEFT"),
        (("--region", "0,0,500,500", *QUICK), 1, "region"),
    ],
)
def test_wrong_usage_is_one_clear_line(command, arguments, status, words):
    code, _, said = command(*arguments)
    assert code == status
    assert words in said
    assert len(said.strip().splitlines()) == 1


@PROFILE
@given(st.sampled_from([".npy", ".npz", ".png"]), st.data())
def test_a_damaged_file_is_read_or_refused_in_a_line(suffix, data):
    image = np.add.outer(np.arange(40.0), np.arange(50.0))
    stream = io.BytesIO()
    match suffix:
        case ".npy":
            np.save(stream, image)
        case ".npz":
            np.savez_compressed(stream, truth=image, other=np.array("text"))
        case ".png":
            stream.write(cv2.imencode(suffix, image.astype(np.uint16))[1].tobytes())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        path.write_bytes(data.draw(torn(stream.getvalue())))
        try:
            load_truth(path)
        except (TruthError, FusionInputError) as error:
            assert_one_clear_line(error)


@pytest.mark.parametrize("array", [np.array(3.0), np.zeros((0, 4)), np.zeros((2, 3, 4)), np.array(["a"])])
def test_arrays_that_are_no_map_are_refused(tmp_path, array):
    np.savez(tmp_path / "map.npz", truth=array)
    with pytest.raises(TruthError, match=r"expected \(rows, columns\)|not a NumPy archive of numbers"):
        load_truth(tmp_path / "map.npz")
    np.save(tmp_path / "map.npy", array)
    (tmp_path / "map.npy").rename(tmp_path / "plain.npz")
    with pytest.raises(TruthError, match="not a NumPy archive of numbers"):
        load_truth(tmp_path / "plain.npz")
