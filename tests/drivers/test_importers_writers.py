"""SR4000 files as other writers make them: other spellings, no time, z alone, another lens."""

from pathlib import Path

import numpy as np
import pytest
from made_imports import (
    STEP,
    Scene,
    only,
    other_camera,
    raw_images,
    rays,
    text,
    write_bdat,
    write_depth,
    write_text,
)

from drivers import RecordingError, sr4000_calibration
from drivers.importers import ImportOptions, import_frames

OTHER = Path(__file__).parents[3] / "shared" / "data" / "sr4000_other"
RATE = ImportOptions(frame_rate=25)


RECORDER = {"titles": "%/ {}", "apart": " ", "metres": "%.6g", "milliseconds": None}
"""Blanks, six digits, no time."""

STYLES = {
    "public recorder": RECORDER,
    "one line for each image": RECORDER | {"titles": "%% {} [m]", "one_line": True},
    "a blank before the title": RECORDER | {"titles": " % {} [m]", "one_line": True},
    "separated by commas": {"apart": ","},
    "separated by semicolons": {"apart": "; "},
    "exponents": {"metres": "%.7e"},
    "titles that say nothing": {"titles": "% --- "},
}


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_every_writers_layout_gives_the_same_counts(tmp_path, style):
    scene = Scene()
    frame = only(write_text(tmp_path / "a.dat", scene, **style))
    np.testing.assert_array_equal(frame.counts, scene.expected)
    np.testing.assert_array_equal(frame.amplitude, scene.amplitude)
    assert frame.timestamp == (0 if style.get("milliseconds", 31) is None else 31_000_000)


def comma(content):
    return content.replace(".", ",").encode()


SPELLINGS = {
    "decimal comma": comma,
    "decimal comma apart by semicolons": lambda content: comma(content).replace(b"\t", b"; "),
    "byte order mark": lambda content: content.encode("utf-8-sig"),
    "sixteen bits": lambda content: content.encode("utf-16"),
    "line ends of Windows": lambda content: content.replace("\n", "\r\n").encode(),
    "line ends of the old Macintosh": lambda content: content.replace("\n", "\r").encode(),
    "blank lines and blanks": lambda content: content.replace("\n", " \n\n").encode(),
    "a title in another code": lambda content: content.replace("Amplitude", "Amplitude é").encode("latin-1"),
    "lines cut at other places": lambda content: content.replace("\t", "\n", 3000).encode(),
}


@pytest.mark.parametrize("spell", SPELLINGS.values(), ids=SPELLINGS)
def test_every_spelling_gives_the_same_counts(tmp_path, spell):
    scene = Scene()
    path = tmp_path / "a.dat"
    path.write_bytes(spell(text(scene, 63)))
    frame = only(path)
    np.testing.assert_array_equal(frame.counts, scene.expected)
    assert frame.timestamp == 63_000_000


@pytest.mark.parametrize(
    "word",
    [
        "nan",
        "NaN",
        "-nan",
        "-nan(ind)",
        "nan(snan)",
        "-1.#IND",
        "1.#QNAN",
        "1.#INF",
        "-1.#INF00",
        "1.#J",
        "-1,#IND",
        "inf",
        "-inf",
        "Infinity",
    ],
)
def test_what_is_not_a_number_rejects_its_pixel(tmp_path, word):
    scene = Scene()
    scene.confidence[:] = 7
    lines = text(scene).splitlines()
    for line in (1, 146, 291, 436):  # the first row of z, x, y, amplitude
        _, tail = lines[line].split("\t", 1)
        lines[line] = f"{word}\t{tail}"
    content = "\n".join(lines)
    path = tmp_path / "a.dat"
    path.write_text(content.replace(".", ",") if "," in word else content)
    frame = only(path)
    expected = scene.counts.copy()
    expected[0, 0] = 0
    np.testing.assert_array_equal(frame.counts, expected)
    assert frame.amplitude[0, 0] == 0


def test_images_are_told_by_their_titles_in_any_order(tmp_path):
    scene = Scene()
    images = ("x", "y", "z", "confidence", "amplitude")
    frame = only(write_text(tmp_path / "a.dat", scene, images=images))
    np.testing.assert_array_equal(frame.counts, scene.expected)
    np.testing.assert_array_equal(frame.amplitude, scene.amplitude)


def test_without_confidence_no_pixel_is_rejected_and_that_is_said(tmp_path):
    scene = Scene()
    found = import_frames([write_text(tmp_path / "a.dat", scene, images=scene.images[:4])])
    (frame,) = found.frames()
    np.testing.assert_array_equal(frame.counts, scene.counts)
    assert "no confidence is stored: no pixel with a distance is rejected" in found.findings.notes


def test_files_without_times_want_a_frame_rate_and_one_frame_does_not(tmp_path):
    paths = [write_text(tmp_path / f"f{number}.dat", Scene(number), None) for number in range(3)]
    found = import_frames(paths[:1])
    assert [frame.timestamp for frame in found.frames()] == [0]
    assert "no times are stored; f0.dat is taken to be at 0 s" in found.findings.notes
    with pytest.raises(RecordingError, match="says no times; give the frame rate"):
        list(import_frames(paths).frames())
    assert [frame.timestamp for frame in import_frames(paths, RATE).frames()] == [0, 40_000_000, 80_000_000]


def test_files_are_taken_in_natural_order_and_their_times_stay(tmp_path):
    for number in (1, 2, 10, 11):
        write_text(tmp_path / f"f{number}.dat", Scene(number), number * 31)
    given = sorted(tmp_path.iterdir())
    assert [path.name for path in given] == ["f1.dat", "f10.dat", "f11.dat", "f2.dat"]
    found = import_frames(given)
    times = [frame.timestamp for frame in found.frames()]
    assert times == [31_000_000, 62_000_000, 310_000_000, 341_000_000]
    assert "files are taken in the natural order of their names: 2 before 10" in found.findings.notes
    assert not any("clock" in note for note in found.findings.notes)


def test_times_since_the_epoch_stay_exact(tmp_path):
    write_bdat(tmp_path / "d1_0000001.bdat", Scene())
    (tmp_path / "timestamp.log").write_text("0000001 1430000000.123457\n")
    assert only(tmp_path / "d1_0000001.bdat").timestamp == 1_430_000_000_123_457_000
    assert (
        only(write_text(tmp_path / "a.dat", Scene(), "1430000000123.457")).timestamp
        == 1_430_000_000_123_457_000
    )


@pytest.mark.parametrize("line", ["1 nan", "1 1e999999999", "1 -3", "x 0.5", "1", "1 0.5\n1 0.7"])
def test_a_log_that_says_no_time_is_refused(tmp_path, line):
    path = write_bdat(tmp_path / "d1_0001.bdat", Scene())
    (tmp_path / "timestamp.log").write_text(line + "\n")
    with pytest.raises(RecordingError, match=r"timestamp\.log: (expected lines|has two times)"):
        only(path)


@pytest.mark.parametrize("second", [{"milliseconds": None}, {"images": Scene.images[:4]}])
def test_files_of_two_kinds_are_refused(tmp_path, second):
    paths = [write_text(tmp_path / "a.dat", Scene()), write_text(tmp_path / "b.dat", Scene(), **second)]
    with pytest.raises(RecordingError, match=r"b\.dat: holds .* import each kind by itself"):
        list(import_frames(paths, RATE).frames())
    paths = [write_bdat(tmp_path / "a.bdat", Scene()), write_depth(tmp_path / "b.bdat", Scene())]
    with pytest.raises(RecordingError, match=r"b\.bdat: holds z, amplitude, .* import each kind by itself"):
        list(import_frames(paths, RATE).frames())


def test_z_in_millimetres_becomes_radial_along_each_ray(tmp_path):
    scene = Scene(calibration=other_camera())
    path = write_depth(tmp_path / "d1_0001.bdat", scene)
    found = import_frames([path], ImportOptions(calibration=other_camera()))
    (frame,) = found.frames()
    cosine = rays(other_camera())[2]
    assert cosine.min() < 0.91
    np.testing.assert_allclose(frame.distance, scene.steps * STEP, atol=0.5e-3 / cosine.min() + 5 / 65536)
    np.testing.assert_array_equal(frame.amplitude, scene.amplitude)
    assert any("along the rays of the calibration given" in note for note in found.findings.notes)
    nominal = import_frames([path])
    assert nominal.calibration == sr4000_calibration()
    list(nominal.frames())
    assert any("nominal optics" in note for note in nominal.findings.notes)


def test_z_of_a_rejected_pixel_gives_no_distance(tmp_path):
    scene = Scene()
    scene.z[3, 4], scene.z[5, 6] = -0.010, 0.0
    frame = only(write_depth(tmp_path / "a.bdat", scene))
    assert frame.counts[3, 4] == frame.counts[5, 6] == 0
    assert np.count_nonzero(frame.counts == 0) == 2


def test_radial_counts_in_place_of_z_are_refused(tmp_path):
    (images,) = raw_images(1)
    images.tofile(tmp_path / "a.bdat")
    with pytest.raises(RecordingError, match=r"beyond the 5\.000 m .* of another kind"):
        only(tmp_path / "a.bdat")


def test_files_are_ordinary_and_no_longer_than_a_frame(tmp_path):
    long = tmp_path / "long.dat"
    with long.open("wb") as file:
        file.truncate(1 << 33)
    with pytest.raises(RecordingError, match=r"has more than 16,777,216 bytes, the most that a text frame"):
        import_frames([long])
    (tmp_path / "zero.dat").symlink_to("/dev/zero")
    with pytest.raises(RecordingError, match="is not an ordinary file"):
        import_frames([tmp_path / "zero.dat"])


@pytest.mark.skipif(not OTHER.exists(), reason="real SR4000 frames of other writers are not at hand")
def test_a_real_frame_of_z_alone_comes_back_in_millimetres():
    path = OTHER / "d1_1000.bdat"
    found = import_frames([path])
    (frame,) = found.frames()
    amplitude, z = np.fromfile(path, "<u2").reshape(2, 144, 176)
    np.testing.assert_array_equal(frame.amplitude, amplitude)
    forward = frame.distance * rays(sr4000_calibration())[2] - 0.010
    assert np.abs(forward * 1e3 - z).max() < 0.05
