"""Importers: files made here to the published layouts, and real SR4000 frames where they are at hand."""

from pathlib import Path

import numpy as np
import pytest
from made_imports import Scene, rays, vendor_points, write_bdat, write_text

from drivers import RecordingError, sr3000_calibration, sr4000_calibration
from drivers.importers import ImportOptions, import_frames

GRAY = "amplitude is taken to be in gray mode, the vendor's default: the files do not say"
REAL = Path(__file__).parents[3] / "shared" / "data" / "sr4000"


def test_text_frame_gives_the_counts_that_the_camera_measured(tmp_path):
    scene = Scene()
    found = import_frames([write_text(tmp_path / "frm_0001.dat", scene, 63)])
    (frame,) = found.frames()
    np.testing.assert_array_equal(frame.counts, scene.expected)
    np.testing.assert_array_equal(frame.amplitude, scene.amplitude)
    assert (frame.timestamp, frame.sequence, frame.burst, frame.pose) == (63_000_000, 0, 0, 0)
    assert (frame.amplitude_mode, frame.integration_time) == ("gray", None)
    assert (frame.modulation_frequency, frame.ambiguity_range) == (30e6, 5.0)
    assert (frame.pan, frame.tilt) == (0.0, 0.0)
    assert (found.source.model, found.count) == ("SR4000", 1)
    assert found.findings.notes == [GRAY]


def test_distances_off_the_cameras_steps_are_not_forced_onto_them(tmp_path):
    scene = Scene()
    radius = np.linspace(1.0, 4.0, 144 * 176).reshape(144, 176)
    scene.x, scene.y, scene.z = vendor_points(radius, sr4000_calibration())
    scene.confidence[:] = 7
    (frame,) = import_frames([write_text(tmp_path / "a.dat", scene)]).frames()
    assert np.abs(frame.distance - radius).max() < 0.0002  # the text's own rounding
    assert (frame.counts % 4 != 0).mean() > 0.7


def test_options_are_taken(tmp_path):
    options = ImportOptions(integration_time=0.0032, amplitude_mode="linear", modulation_frequency=15e6)
    (frame,) = import_frames([write_text(tmp_path / "a.dat", Scene())], options).frames()
    assert (frame.integration_time, frame.amplitude_mode) == (0.0032, "linear")
    assert (frame.modulation_frequency, frame.ambiguity_range) == (15e6, 10.0)


def test_files_are_numbered_and_cut_into_bursts(tmp_path):
    paths = [write_text(tmp_path / f"f{number}.dat", Scene(number), number * 31) for number in range(3)]
    whole = list(import_frames(paths).frames())
    assert [(f.sequence, f.burst, f.pose, f.timestamp) for f in whole] == [
        (0, 0, 0, 0),
        (1, 0, 1, 31_000_000),
        (2, 0, 2, 62_000_000),
    ]
    cut = list(import_frames(paths, frames_per_burst=2).frames())
    assert [(f.burst, f.pose) for f in cut] == [(0, 0), (0, 1), (1, 0)]


def test_a_clock_that_starts_again_is_carried_on(tmp_path):
    paths = [
        write_text(tmp_path / f"f{number}.dat", Scene(), time) for number, time in enumerate((5, 35, 5, 36))
    ]
    found = import_frames(paths)
    assert [frame.timestamp // 1_000_000 for frame in found.frames()] == [5, 35, 65, 96]
    assert found.findings.notes == [
        GRAY,
        "the clock goes back at f2.dat, from 0.035 s to 0.005 s: from there on 0.060 s are added to what the "
        "files say",
    ]


def test_points_that_do_not_fit_a_given_calibration_are_noted(tmp_path):
    options = ImportOptions(calibration=sr3000_calibration(), amplitude_mode="gray")
    found = import_frames([write_text(tmp_path / "a.dat", Scene())], options)
    list(found.frames())
    assert found.calibration == sr3000_calibration()
    assert found.optics_residual is None
    assert "from where the calibration puts them" in found.findings.notes[0]


def text_lines(tmp_path):
    return write_text(tmp_path / "good.dat", Scene()).read_text().splitlines(keepends=True)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda _: [], "is empty; expected an SR4000 text frame"),
        (lambda _: ["1 2 3\n"], "does not begin with a title line"),
        (lambda lines: lines[:500], "image amplitude has 64 × 176 values, z has 144 × 176"),
        (lambda lines: lines[:400], "has 3 sections (z, x, y), expected z, x, y, amplitude"),
        (lambda lines: [*lines, *lines[:146]], "has 8 sections (z, x, y, amplitude, confidence, time, z, x)"),
        (lambda lines: [*lines[:20], "1_" + lines[20], *lines[21:]], "image z is torn or garbled"),
        (lambda lines: [*lines[:-1], "1e30 nan\n"], "its time is 1e30 ms; expected 0 to"),
        (lambda lines: [*lines[:-1], "-5 nan\n"], "its time is -5 ms; expected 0 to"),
        (lambda lines: lines[:300] + lines[400:], "image y has 44 × 176 values"),
        (lambda lines: [*lines[:20], "1.0 2.0\n", *lines[21:]], "image z is torn or garbled"),
        (lambda lines: [*lines[:20], lines[20].replace(".", "x"), *lines[21:]], "image z is torn or garbled"),
        (lambda lines: lines[:-1], "holds no time in milliseconds"),
        (lambda lines: [*lines[:-1], "nan\tnan\n"], "its time is nan"),
        (lambda lines: ["% t\n", *lines[2:]], "image x has 144 × 176 values, z has 143 × 176"),
    ],
)
def test_bad_text_frames_are_refused_in_one_line(tmp_path, spoil, said):
    path = tmp_path / "bad.dat"
    path.write_text("".join(spoil(text_lines(tmp_path))))
    with pytest.raises(RecordingError) as caught:
        list(import_frames([path]).frames())
    assert said in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_binary_data_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a.dat").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingError, match="is not text"):
        list(import_frames([tmp_path / "a.dat"]).frames())
    with pytest.raises(RecordingError, match="No such file"):
        list(import_frames([tmp_path / "b.dat"]).frames())


def test_frames_of_another_size_than_the_calibration_are_refused(tmp_path):
    scene = Scene()
    for name in ("x", "y", "z", "amplitude", "confidence"):
        setattr(scene, name, getattr(scene, name)[:100, :120])
    with pytest.raises(RecordingError, match="has 100 × 120 pixels, its calibration is for 144 × 176"):
        list(import_frames([write_text(tmp_path / "a.dat", scene)]).frames())


def test_distances_beyond_the_range_are_refused_not_wrapped(tmp_path):
    scene = Scene()
    scene.x, scene.y, scene.z = scene.x * 2, scene.y * 2, scene.z * 2
    path = write_text(tmp_path / "a.dat", scene)
    with pytest.raises(RecordingError, match=r"beyond the 5\.000 m that can be told apart at 30 MHz"):
        list(import_frames([path]).frames())


def test_amplitudes_that_are_no_counts_are_refused(tmp_path):
    scene = Scene()
    scene.amplitude[3, 4] = 70_000
    with pytest.raises(RecordingError, match="amplitudes run from 0 to 70000; expected 0 to 65535"):
        list(import_frames([write_text(tmp_path / "a.dat", scene)]).frames())


def test_what_to_import_must_be_of_one_known_kind(tmp_path):
    for paths, said in (
        ([], "no file to import"),
        (["a.jpg"], r"cannot be imported as '\.jpg'; known are \.srs, \.bdat, \.bin, \.dat, \.txt"),
        ([""], "is a folder without bag or pictures"),
        (["a.dat", "b.bdat"], r"several formats \(\.bdat, \.dat\)"),
    ):
        with pytest.raises(RecordingError, match=said):
            import_frames([tmp_path / path for path in paths])


def test_bdat_gives_the_same_counts_and_the_times_of_its_log(tmp_path):
    scenes = [Scene(0), Scene(1)]
    paths = [write_bdat(tmp_path / f"d_{number + 7:04d}.bdat", scene) for number, scene in enumerate(scenes)]
    (tmp_path / "timestamp.log").write_text("7 0.031000\n8 0.062500\n")
    found = import_frames(paths)
    frames = list(found.frames())
    for frame, scene in zip(frames, scenes, strict=True):
        np.testing.assert_array_equal(frame.counts, scene.expected)
        np.testing.assert_array_equal(frame.amplitude, scene.amplitude)
    assert [frame.timestamp for frame in frames] == [31_000_000, 62_500_000]
    assert "gray mode, the vendor's default" in found.findings.notes[0]


def test_bdat_without_times_or_of_the_wrong_size_is_refused(tmp_path):
    path = write_bdat(tmp_path / "d_0001.bdat", Scene())
    with pytest.raises(RecordingError, match=r"says no times; give the frame rate"):
        list(import_frames([path, path]).frames())
    frames = import_frames([path, path], ImportOptions(frame_rate=25)).frames()
    assert [frame.timestamp for frame in frames] == [0, 40_000_000]
    (tmp_path / "timestamp.log").write_text("3 0.5\n")
    with pytest.raises(RecordingError, match="has no line for frame 1"):
        list(import_frames([path]).frames())
    (tmp_path / "timestamp.log").write_text("one two three\n")
    with pytest.raises(RecordingError, match="expected lines of a frame's number and seconds"):
        list(import_frames([path]).frames())
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordingError, match=r"has 405,503 bytes, expected 405,504"):
        list(import_frames([path]).frames())


@pytest.mark.skipif(not REAL.exists(), reason="real SR4000 frames are not at hand")
def test_real_frames_come_back_within_a_millimetre():
    """Counts, the calibration and the vendor's origin together give back every x, y, z of eight frames."""
    paths = sorted(REAL.glob("*/*.dat"))
    found = import_frames(paths, frames_per_burst=4)
    frames = list(found.frames())
    directions = rays(found.calibration)
    worst = 0.0
    for path, frame in zip(paths, frames, strict=True):
        table = np.loadtxt(path, comments="%")
        z, x, y, amplitude, confidence = (table[144 * k : 144 * (k + 1)] for k in range(5))
        assert (frame.counts % 4 == 0).all()  # 14 significant bits
        np.testing.assert_array_equal(frame.counts == 0, confidence == 0)
        np.testing.assert_array_equal(frame.amplitude, amplitude)
        right, down, forward = frame.distance * directions
        error = np.stack([-right - x, -down - y, forward - 0.010 - z])[:, confidence > 0]
        worst = max(worst, np.abs(error).max())
        assert np.sqrt(np.mean(error**2)) < 0.00015
    assert worst < 0.001
    assert [frame.timestamp // 1_000_000 for frame in frames[:4]] == [0, 32, 63, 94]
    assert found.optics_residual < 0.01
    assert found.findings.lost == []
    assert found.findings.notes == [
        GRAY,
        "the clock goes back at frm_0001.dat, from 0.094 s to 0.000 s: from there on 0.125 s are added to "
        "what the files say",
    ]
