"""Streams of the vendor's software, made here to the published container."""

import struct

import numpy as np
import pytest
from made_imports import raw_images, srs_camera, srs_frame, srs_object, srs_registers, write_srs

from drivers import RecordingError, sr3000_calibration
from drivers.importers import ImportOptions, import_frames

RAW = ImportOptions(accept_inferred=True, frame_rate=10)
SR2 = 0x0071

CAMERA_DATA = b"""<?xml version="1.0" encoding="UTF-8"?>
<?xml version="1.0" encoding="utf-8"?>
<SwissRanger Version="1">
  <Sensor Serial="0" PixNum="%s" PixSz="40e-6 40e-6"><Geometry Focal="8E-3" OptCtr="92 60"/>%s</Sensor>
</SwissRanger>"""
"""As the vendor writes it, with the two declarations that one of its files has."""


def camera_data(pixels=b"176 144", extra=b""):
    return CAMERA_DATA % (pixels, extra)


def stream(path, frames, product=0x0074, between=(), serial=0x19E13, **registers):
    """A stream of one camera: what is in `between` stands before the frames."""
    head = [srs_camera(product, serial), srs_registers(**registers), *between]
    return write_srs(path, [*head, *map(srs_frame, frames)])


@pytest.mark.parametrize(
    ("product", "model", "frequency"), [(0x0074, "SR3000", 20e6), (0x0075, "SR4000", 30e6)]
)
@pytest.mark.parametrize("signature", [b"srIO", b"OIrs"])
def test_stream_gives_its_raw_frames(tmp_path, product, model, frequency, signature):
    made = raw_images(3)
    own = srs_object(0x8000_0001, b"a user's own")
    objects = [srs_camera(product), srs_registers(), own, *map(srs_frame, made)]
    found = import_frames([write_srs(tmp_path / "a.srs", objects, signature)], RAW)
    frames = list(found.frames())
    for frame, (counts, amplitude) in zip(frames, made, strict=True):
        np.testing.assert_array_equal(frame.counts, counts)
        np.testing.assert_array_equal(frame.amplitude, amplitude)
    assert (found.source.model, found.source.serial, found.count) == (model, "00019e13", 3)
    assert {frame.modulation_frequency for frame in frames} == {frequency}
    assert [frame.timestamp for frame in frames] == [0, 100_000_000, 200_000_000]
    assert any("raw as far as is known" in note for note in found.findings.notes)
    assert found.findings.lost == []


def test_an_sr2_has_160_rows_of_124_and_its_amplitude_last(tmp_path):
    made = raw_images(2, (160, 124), 3)
    found = import_frames([stream(tmp_path / "a.srs", made, SR2, r2=0xC0, r9=49)], RAW)
    frames = list(found.frames())
    for frame, (distance, _, amplitude) in zip(frames, made, strict=True):
        np.testing.assert_array_equal(frame.counts, distance)
        np.testing.assert_array_equal(frame.amplitude, amplitude)
        assert frame.integration_time == pytest.approx(10e-3)
    optics = found.calibration.intrinsics
    assert (optics.fx, optics.fy) == pytest.approx((8e-3 / 54.8e-6, 8e-3 / 39.2e-6))
    assert (optics.cx, optics.cy) == (62, 80)
    assert any("taken for an SR2B" in note for note in found.findings.notes)


def test_an_sr2s_integration_time_follows_its_registers(tmp_path):
    one, other = raw_images(2, (160, 124), 3)
    again = [srs_frame(one), srs_registers(r2=0xC0, r9=99), srs_frame(other)]
    path = write_srs(tmp_path / "a.srs", [srs_camera(SR2), srs_registers(r2=0xC0, r9=49), *again])
    frames = list(import_frames([path], RAW).frames())
    assert [frame.integration_time for frame in frames] == pytest.approx([10e-3, 20e-3])
    told = RAW.model_copy(update={"integration_time": 0.005})
    assert {frame.integration_time for frame in import_frames([path], told).frames()} == {0.005}


def test_intensity_is_not_taken_for_amplitude(tmp_path):
    path = stream(tmp_path / "a.srs", raw_images(1, (160, 124), 2), SR2)
    with pytest.raises(RecordingError, match=r"hold distance and intensity, not amplitude .* is 0x00"):
        list(import_frames([path], RAW).frames())


@pytest.mark.parametrize("product", [0x0074, 0x0075])
def test_a_test_pattern_is_no_distance(tmp_path, product):
    path = stream(tmp_path / "a.srs", raw_images(1), product, r4=1)
    with pytest.raises(RecordingError, match=r"holds a test pattern, not distances \(register 4 is 1\)"):
        list(import_frames([path], RAW).frames())


def test_registers_that_change_in_mid_stream_are_said(tmp_path):
    one, other = raw_images(2)
    objects = [srs_camera(), srs_registers(), srs_frame(one), srs_registers(r9=3, r12=1), srs_frame(other)]
    found = import_frames([write_srs(tmp_path / "a.srs", objects)], RAW)
    assert len(list(found.frames())) == 2
    assert any("a.srs: registers 9, 12 change at frame 1" in note for note in found.findings.notes)


def calibrated(tmp_path, content):
    path = stream(tmp_path / "a.srs", raw_images(1), between=[srs_object(4, content)])
    return import_frames([path], RAW)


def test_the_streams_own_calibration_gives_the_optics(tmp_path):
    found = calibrated(tmp_path, camera_data())
    optics = found.calibration.intrinsics
    assert (optics.fx, optics.fy, optics.cx, optics.cy) == pytest.approx((200, 200, 92, 60))
    assert found.findings.notes == ["optics: calibration in a.srs"]
    told = RAW.model_copy(update={"calibration": sr3000_calibration()})
    assert import_frames([tmp_path / "a.srs"], told).calibration == sr3000_calibration()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (camera_data(b"124 160"), "gives no optics (no geometry, or of another sensor)"),
        (camera_data().replace(b"40e-6 ", b"0 "), "gives no optics"),
        (camera_data().replace(b"8E-3", b"nan"), "gives no optics"),
        (bytes(range(256)) * 4, "its calibration is no XML that is known"),
        (b"", "its calibration is no XML that is known"),
        (b"<a/>", "its calibration is no XML that is known"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_said(tmp_path, content, said):
    found = calibrated(tmp_path, content)
    assert found.calibration == sr3000_calibration()
    assert any(said in note for note in found.findings.notes)


def test_a_fixed_pattern_is_said_not_to_be_applied(tmp_path):
    pattern = b'<Calib Frq="20MHz" FixPatternNoise="AAAA"/>'
    found = calibrated(tmp_path, camera_data(extra=pattern))
    assert found.calibration.intrinsics.cx == 92
    assert any("fixed pattern of its calibration is not applied" in note for note in found.findings.notes)


def test_inferred_parts_must_be_accepted(tmp_path):
    path = stream(tmp_path / "a.srs", raw_images(1))
    with pytest.raises(RecordingError, match=r"is inferred, not documented .* accept that with --inferred"):
        import_frames([path], ImportOptions(frame_rate=10))


def test_a_torn_stream_gives_its_whole_frames_and_says_so(tmp_path):
    path = stream(tmp_path / "a.srs", raw_images(3))
    path.write_bytes(path.read_bytes()[:-1000])
    found = import_frames([path], RAW)
    assert len(list(found.frames())) == 2
    assert found.findings.lost == [
        f"{path}: torn or garbled at byte 202,876: all before was read, nothing after"
    ]


def test_an_object_of_unknown_id_is_passed_over_and_said(tmp_path):
    path = stream(tmp_path / "a.srs", raw_images(1), between=[srs_object(9, b"?")])
    found = import_frames([path], RAW)
    assert len(list(found.frames())) == 1
    assert found.findings.lost == [f"{path}: an object of unknown id 9 at byte 100 was passed over"]


def test_streams_of_two_cameras_are_refused(tmp_path):
    one = stream(tmp_path / "a.srs", raw_images(1))
    for other in (
        stream(tmp_path / "b.srs", raw_images(1), serial=7),
        stream(tmp_path / "c.srs", raw_images(1), 0x75),
    ):
        with pytest.raises(RecordingError, match="import each camera's streams by themselves"):
            import_frames([one, other], RAW)
    objects = [srs_camera(), srs_registers(), srs_frame(raw_images(1)), srs_camera(serial=7)]
    path = write_srs(tmp_path / "d.srs", objects)
    with pytest.raises(RecordingError, match=r"goes on with another camera \(SR3000 00000007 after"):
        list(import_frames([path], RAW).frames())


def test_odd_streams_are_refused(tmp_path):
    path = tmp_path / "a.srs"
    for content, said in (
        (write_srs(path, [], version=2).read_bytes(), r"version 2"),
        (write_srs(path, [], signature=b"RIFF").read_bytes(), r"begins with 52 49 46 46"),
        (write_srs(path, [srs_camera(0x9999)]).read_bytes(), r"0x9999; known are 0x0071 \(SR2\)"),
        (b"", r"begins with nothing"),
        (b"srIO" + struct.pack("<I", 1) + bytes(30), r"does not begin with the camera's description"),
        (write_srs(path, [srs_camera(), srs_frame(raw_images(1))]).read_bytes(), "the camera's registers"),
    ):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=said):
            list(import_frames([path], RAW).frames())
    stream(path, raw_images(1, (144, 100)))
    with pytest.raises(RecordingError, match=r"a frame has 57,600 bytes, expected 101,376"):
        list(import_frames([path], RAW).frames())
