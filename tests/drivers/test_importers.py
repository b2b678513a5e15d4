"""Importers: files made here to the published layouts, and real SR4000 frames where they are at hand."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers import RecordingError, sr3000_calibration, sr4000_calibration
from drivers.importers import ImportOptions, import_frames
from drivers.importers.bdat import LAYOUT

REAL = Path(__file__).parents[3] / "shared" / "data" / "sr4000"
STEP = 5.0 / 16384
"""Metres; the SR4000's distance step at 30 MHz."""


def rays(calibration):
    """(3, H, W) unit rays in camera axes."""
    rows, columns = np.mgrid[: calibration.height, : calibration.width].astype(np.float64)
    flat = cv2.undistortPoints(
        np.stack([columns, rows], axis=-1).reshape(-1, 1, 2),
        calibration.intrinsics.matrix,
        np.asarray(calibration.distortion),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    ).reshape(calibration.height, calibration.width, 2)
    directions = np.stack([flat[..., 0], flat[..., 1], np.ones(flat.shape[:2])])
    return directions / np.linalg.norm(directions, axis=0)


def vendor_points(radius, calibration):
    """x (left), y (up), z (forward, from 10 mm in front of the centre) as the vendor's library gives them."""
    right, down, forward = radius * rays(calibration)
    return -right, -down, forward - 0.010


class Scene:
    """A wall seen at an angle, on the camera's distance steps."""

    def __init__(self, seed=0):
        random = np.random.default_rng(seed)
        slope = np.linspace(1.2, 4.9, 144 * 176).reshape(144, 176) + random.normal(0, 0.01, (144, 176))
        self.steps = np.round(slope / STEP)
        self.counts = (self.steps * 4).astype(np.uint16)
        self.x, self.y, self.z = vendor_points(self.steps * STEP, sr4000_calibration())
        self.amplitude = random.integers(0, 3500, (144, 176))
        self.confidence = random.integers(0, 8, (144, 176))
        self.expected = np.where(self.confidence > 0, self.counts, 0)


def write_text(path, scene, milliseconds=31):
    def block(title, image, form):
        return f"% {title}\n" + "\n".join("\t".join(form % value for value in row) for row in image) + "\n"

    nans = "\tnan" * (scene.z.shape[1] - 1)
    path.write_text(
        block("Calibrated Distance", scene.z, "%.4f")
        + block("Calibrated xVector", scene.x, "%.4f")
        + block("Calibrated yVector", scene.y, "%.4f")
        + block("Amplitude", scene.amplitude, "%d")
        + block("Confidence map", scene.confidence, "%d")
        + f"% additional data / time stamp [ms]\n{milliseconds}{nans}\n",
        encoding="ascii",
    )
    return path


def write_bdat(path, scene):
    frame = np.zeros((), LAYOUT)
    for name in ("z", "x", "y", "amplitude", "confidence"):
        frame[name] = getattr(scene, name)
    path.write_bytes(frame.tobytes())
    return path


def srs_object(kind, payload):
    return struct.pack("<II", kind, 8 + len(payload)) + payload


def write_srs(path, frames, product=0x0074, signature=b"srIO", version=1):
    objects = [srs_object(1, struct.pack("<III", product, 0, 0x19E13)), srs_object(2, bytes(64))]
    objects.append(srs_object(4, b"<xml/>"))
    objects += [srs_object(3, counts.tobytes() + amplitude.tobytes()) for counts, amplitude in frames]
    objects.insert(4, srs_object(0x8000_0001, b"a user's own"))
    path.write_bytes(signature + struct.pack("<I", version) + b"".join(objects))
    return path


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
    assert (found.calibration, found.source.model, found.count) == (sr4000_calibration(), "SR4000", 1)
    assert found.findings.notes == []


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
    assert found.findings.notes == ["the clock starts again at f2.dat; its times follow on the last"]


def test_points_of_another_lens_are_noted(tmp_path):
    scene = Scene()
    scene.x, scene.y, scene.z = vendor_points(scene.steps * STEP, sr3000_calibration())
    found = import_frames([write_text(tmp_path / "a.dat", scene)])
    list(found.frames())
    assert "from where the calibration puts them" in found.findings.notes[0]


def text_lines(tmp_path):
    return write_text(tmp_path / "good.dat", Scene()).read_text().splitlines(keepends=True)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda _: [], "is empty; expected an SR4000 text frame"),
        (lambda _: ["1 2 3\n"], "does not begin with a title line"),
        (lambda lines: lines[:500], "has 4 sections, expected 5 images and a time: the file is torn"),
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
        (["a.jpg"], r"cannot be imported as '\.jpg'; known are \.srs, \.bdat, \.dat, \.txt"),
        ([""], "is a folder; name its files"),
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
        list(import_frames([path]).frames())
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


RAW = ImportOptions(accept_inferred=True, frame_rate=10)


def raw_frames(count, shape=(144, 176)):
    random = np.random.default_rng(3)
    return [random.integers(0, 65536, (2, *shape), np.uint16) for _ in range(count)]


@pytest.mark.parametrize(
    ("product", "model", "frequency"), [(0x0074, "SR3000", 20e6), (0x0075, "SR4000", 30e6)]
)
@pytest.mark.parametrize("signature", [b"srIO", b"OIrs"])
def test_srs_stream_gives_its_raw_frames(tmp_path, product, model, frequency, signature):
    made = raw_frames(3)
    found = import_frames([write_srs(tmp_path / "a.srs", made, product, signature)], RAW)
    frames = list(found.frames())
    for frame, (counts, amplitude) in zip(frames, made, strict=True):
        np.testing.assert_array_equal(frame.counts, counts)
        np.testing.assert_array_equal(frame.amplitude, amplitude)
    assert (found.source.model, found.source.serial, found.count) == (model, "00019e13", 3)
    assert {frame.modulation_frequency for frame in frames} == {frequency}
    assert [frame.timestamp for frame in frames] == [0, 100_000_000, 200_000_000]
    assert "raw as far as is known" in found.findings.notes[0]


def test_srs_needs_the_word_that_inferred_parts_are_accepted(tmp_path):
    path = write_srs(tmp_path / "a.srs", raw_frames(1))
    with pytest.raises(RecordingError, match=r"is inferred, not documented .* accept that with --inferred"):
        list(import_frames([path], ImportOptions(frame_rate=10)).frames())


def test_torn_srs_stream_gives_its_whole_frames_and_says_so(tmp_path):
    path = write_srs(tmp_path / "a.srs", raw_frames(3))
    path.write_bytes(path.read_bytes()[:-1000])
    found = import_frames([path], RAW)
    assert len(list(found.frames())) == 2
    assert found.findings.lost == [
        f"{path}: torn or garbled at byte 202,902: all before was read, nothing after"
    ]


def test_odd_srs_streams_are_refused(tmp_path):
    path = tmp_path / "a.srs"
    for content, said in (
        (write_srs(path, [], version=2).read_bytes(), r"version 2"),
        (write_srs(path, [], signature=b"RIFF").read_bytes(), r"begins with 52 49 46 46"),
        (write_srs(path, [], product=0x9999).read_bytes(), r"0x9999; known are 0x0071 \(SR2\)"),
        (b"", r"begins with nothing"),
        (b"srIO" + struct.pack("<I", 1) + bytes(30), r"does not begin with the camera's description"),
    ):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=said):
            list(import_frames([path], RAW).frames())
    write_srs(path, raw_frames(1, (144, 100)))
    with pytest.raises(RecordingError, match=r"a frame has 57,600 bytes, expected 101,376"):
        list(import_frames([path], RAW).frames())
    write_srs(path, raw_frames(1, (124, 160)), product=0x0071)
    with pytest.raises(RecordingError, match="nothing is known of the optics of an SR2"):
        import_frames([path], RAW)


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
    assert found.findings.notes == ["the clock starts again at frm_0001.dat; its times follow on the last"]
