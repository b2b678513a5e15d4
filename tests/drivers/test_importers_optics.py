"""Each SR4000's own optics, fitted from the points that its files hold."""

from pathlib import Path

import numpy as np
import pytest
from made_imports import (
    STEP,
    Scene,
    other_camera,
    rays,
    vendor_points,
    write_bdat,
    write_text,
)

from drivers import RecordingError, sr3000_calibration, sr4000_calibration
from drivers.importers import ImportOptions, import_frames

OTHER = Path(__file__).parents[3] / "shared" / "data" / "sr4000_other"


@pytest.mark.parametrize("write", [write_text, write_bdat])
def test_each_cameras_own_optics_come_from_its_points(tmp_path, write):
    scene = Scene(calibration=other_camera())
    suffix = ".dat" if write is write_text else ".bdat"
    found = import_frames([write(tmp_path / f"a{suffix}", scene)])
    (frame,) = found.frames()
    np.testing.assert_array_equal(frame.counts, scene.expected)
    assert found.calibration.intrinsics.fx == pytest.approx(250.8, abs=0.02)
    assert found.calibration.intrinsics.cx == pytest.approx(90.9, abs=0.01)
    assert found.calibration.intrinsics.cy == pytest.approx(71.6, abs=0.01)
    assert found.calibration.distortion == pytest.approx(sr4000_calibration().distortion, abs=0.02)
    assert found.optics_residual < 0.004
    assert (
        found.calibration.source == f"fitted to x, y, z of a{suffix}: residual {found.optics_residual:.3f} px"
    )
    assert found.calibration.noise == sr4000_calibration().noise


def test_whole_millimetres_at_close_range_are_no_other_lens(tmp_path):
    scene = Scene()
    near = vendor_points(0.4 * scene.steps * STEP, sr4000_calibration())  # 0.5 to 2 m
    scene.x, scene.y, scene.z = np.round(near, 3)
    found = import_frames([write_bdat(tmp_path / "a.bdat", scene)])
    assert len(list(found.frames())) == 1
    assert found.findings.lost == []
    assert found.calibration.intrinsics.cx == pytest.approx(87.5, abs=0.02)


def test_a_lens_without_distortion_gets_none(tmp_path):
    scene = Scene(calibration=sr3000_calibration())
    found = import_frames([write_bdat(tmp_path / "a.bdat", scene)])
    assert not np.any(found.calibration.distortion)
    assert found.calibration.intrinsics.fx == pytest.approx(200, abs=0.001)


def test_damaged_numbers_neither_bend_the_lens_nor_become_distances(tmp_path):
    scene = Scene()
    scene.confidence[:] = 7
    scene.z[40, 20:50] += 1.0
    scene.x[100, 100:130] /= 3.0
    path = write_text(tmp_path / "a.dat", scene)
    found = import_frames([path])
    (frame,) = found.frames()
    assert found.optics_residual < 0.004
    expected = scene.counts.copy()
    expected[40, 20:50] = expected[100, 100:130] = 0
    np.testing.assert_array_equal(frame.counts, expected)
    assert found.findings.lost == [
        f"{path}: 60 points do not lie on their pixel's ray, so their numbers are damaged: those pixels are "
        "rejected"
    ]


def test_files_of_two_cameras_are_refused(tmp_path):
    paths = [
        write_text(tmp_path / "a.dat", Scene()),
        write_text(tmp_path / "b.dat", Scene(calibration=other_camera()), 63),
    ]
    with pytest.raises(RecordingError, match=r"b\.dat: its points lie 3\.\d\d pixels .* of another camera"):
        list(import_frames(paths).frames())


def spoil_axes(scene):
    scene.x, scene.y = -scene.x, -scene.y


def spoil_rows(scene):
    scene.y = scene.y[::-1]


def spoil_pixels(scene):
    np.random.default_rng(0).shuffle(scene.x)


@pytest.mark.parametrize("spoil", [spoil_axes, spoil_rows, spoil_pixels])
def test_points_of_no_lens_are_refused_unless_a_calibration_is_named(tmp_path, spoil):
    scene = Scene()
    spoil(scene)
    path = write_text(tmp_path / "a.dat", scene)
    with pytest.raises(RecordingError, match=r"(one lens|left and up).*name the camera's calibration"):
        import_frames([path])
    options = ImportOptions(calibration=sr4000_calibration())
    assert any("check that it is" in note for note in notes(path, options))


def notes(path, options):
    found = import_frames([path], options)
    list(found.frames())
    return found.findings.notes


def test_too_few_points_leave_the_optics_nominal(tmp_path):
    scene = Scene()
    scene.confidence[:, 60:] = 0
    found = import_frames([write_text(tmp_path / "a.dat", scene)])
    (frame,) = found.frames()
    np.testing.assert_array_equal(frame.counts, np.where(scene.confidence > 0, scene.counts, 0))
    assert found.calibration == sr4000_calibration()
    assert found.optics_residual is None
    assert any("x, y, z are too few, or in too small a part" in note for note in found.findings.notes)


@pytest.mark.skipif(not OTHER.exists(), reason="real SR4000 frames of other writers are not at hand")
def test_a_real_frame_of_another_camera_comes_back_with_its_own_optics():
    path = OTHER / "l2o_1000.dat"
    found = import_frames([path])
    (frame,) = found.frames()
    optics = found.calibration.intrinsics
    assert (optics.fx, optics.cx, optics.cy) == pytest.approx((250.8, 90.9, 71.6), abs=0.05)
    assert found.optics_residual == pytest.approx(0.015, abs=0.001)
    assert frame.timestamp == 124_391_000_000
    table = np.loadtxt(path, comments="%")
    z, x, y, amplitude, confidence = (table[144 * k : 144 * (k + 1)] for k in range(5))
    np.testing.assert_array_equal(frame.counts == 0, confidence == 0)
    np.testing.assert_array_equal(frame.amplitude, amplitude)
    right, down, forward = frame.distance * rays(found.calibration)
    error = np.stack([-right - x, -down - y, forward - 0.010 - z])[:, confidence > 0]
    assert np.abs(error).max() < 0.0025
    assert np.sqrt(np.mean(error**2)) < 0.00015
    assert found.findings.lost == []
