"""Folders of depth pictures become frames."""

import cv2
import numpy as np
import pytest

from drivers.calibration import Calibration, Intrinsics
from drivers.depth.reading import DepthReading
from drivers.errors import NotAvailableError, RecordingError
from drivers.importers import ImportOptions, import_frames

SHAPE = 30, 44
LENS = Calibration(width=44, height=30, intrinsics=Intrinsics(fx=40, fy=41, cx=21, cy=14))
RADIAL = DepthReading(kind="distance", scale=1e-3)


def image(number=0):
    rows, columns = np.mgrid[:30, :44]
    found = (1000 + 20 * rows + 3 * columns + 100 * number).astype(np.uint16)
    found[0, 0], found[0, 1] = 0, 0xFFFF
    return found


def save(path, array):
    if path.suffix == ".npy":
        np.save(path, array)
    elif path.suffix == ".exr":
        import OpenEXR

        with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Z": array}) as file:
            file.write(str(path))
    else:
        assert cv2.imwrite(str(path), array)
    return path


def imported(paths, **changes):
    told = {"calibration": LENS, "reading": RADIAL, "frame_rate": 30.0}
    found = import_frames(paths, ImportOptions(**told | changes))
    return found.findings, list(found.frames())


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".npy"])
def test_a_folder_of_whole_numbers_in_natural_order(tmp_path, suffix):
    for number in range(12):
        save(tmp_path / f"depth{number}{suffix}", image(number))
    _, frames = imported([tmp_path])
    assert len(frames) == 12
    assert [frame.timestamp for frame in frames[:2]] == [0, 33_333_333]
    for number, frame in enumerate(frames):
        assert frame.distance[3, 4] == pytest.approx(image(number)[3, 4] * 1e-3)
        assert frame.valid.sum() == frame.counts.size - 2


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".exr"])
def test_floating_values_are_metres(tmp_path, suffix):
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    metres = (image() * 1e-3).astype(np.float32)
    metres[5, 5], metres[6, 6] = np.nan, -1.0
    path = save(tmp_path / f"a{suffix}", metres)
    findings, (frame,) = imported([path], reading=DepthReading(kind="distance"))
    assert frame.counts.dtype == np.float32
    assert frame.distance[3, 4] == metres[3, 4]
    assert np.isnan(frame.distance[[5, 6, 0], [5, 6, 0]]).all()
    assert "floating values are taken to be metres" in findings.notes


def test_times_are_those_in_the_names(tmp_path):
    for name in ("1305031102.175304", "1305031102.211214"):
        save(tmp_path / f"{name}.png", image())
    findings, frames = imported([tmp_path], frame_rate=None)
    assert [frame.timestamp for frame in frames] == [1305031102175304000, 1305031102211214000]
    assert any("names of the files" in note for note in findings.notes)


def test_amplitude_has_the_same_name_elsewhere(tmp_path):
    for name in ("depth", "light"):
        (tmp_path / name).mkdir()
    for number in range(3):
        save(tmp_path / "depth" / f"{number}.png", image(number))
    save(tmp_path / "light" / "0.png", np.full(SHAPE, 200, np.uint8))
    save(tmp_path / "light" / "2.tif", np.full(SHAPE, 255, np.uint8))
    findings, frames = imported([tmp_path / "depth"], amplitude=str(tmp_path / "light"))
    assert [frame.sequence for frame in frames] == [0, 1]
    assert frames[0].amplitude[0, 0] == 200
    assert frames[0].valid.any()
    assert not frames[1].valid.any()  # all saturated
    assert any("1.png: left out" in line for line in findings.lost)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"calibration": None}, r"nothing is known of the optics.*--calibration"),
        ({"reading": DepthReading(kind="distance")}, r"whole numbers \(uint16\).*--scale"),
        ({"reading": DepthReading(scale=1e-3)}, r"--kind depth or --kind distance"),
    ],
)
def test_what_is_not_told_is_asked_for(tmp_path, changes, said):
    save(tmp_path / "a.png", image())
    with pytest.raises(RecordingError, match=said):
        imported([tmp_path], **changes)


def test_torn_pictures_among_good_ones_are_told(tmp_path):
    for number in range(4):
        save(tmp_path / f"{number}.png", image(number))
    whole = (tmp_path / "1.png").read_bytes()
    (tmp_path / "1.png").write_bytes(whole[:30])
    save(tmp_path / "2.png", np.zeros((8, 9, 3), np.uint8))
    findings, frames = imported([tmp_path])
    assert len(frames) == 2
    assert any("1.png: left out" in line for line in findings.lost)
    assert any("3 channels" in line for line in findings.lost)
    save(tmp_path / "3.png", image()[:20])
    findings, frames = imported([tmp_path])
    assert any("20 × 44" in line for line in findings.lost)


def test_several_formats_are_refused(tmp_path):
    save(tmp_path / "a.png", image())
    save(tmp_path / "b.npy", image())
    with pytest.raises(RecordingError, match=r"several formats \(\.npy, \.png\)"):
        imported([tmp_path])


@pytest.mark.parametrize("content", [np.zeros(5), np.zeros((2, 3), complex), np.zeros((0, 4))])
def test_arrays_that_are_no_images_are_refused(tmp_path, content):
    with pytest.raises(RecordingError, match="expected a two-dimensional array"):
        imported([save(tmp_path / "a.npy", content)])


def test_the_library_for_exr_is_named_where_it_is_missing(tmp_path, monkeypatch):
    import sys

    path = tmp_path / "a.exr"
    path.write_bytes(b"v/1\x01")
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(NotAvailableError, match=r"pip install 'lidarboost\[import\]'"):
        imported([path])
