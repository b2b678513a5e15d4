"""The vendor library's driver against a stub library, compiled here, that checks every handle it gets."""

import ctypes
import logging
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from drivers.calibration import sr4000_calibration, sr4500_calibration
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.mesasr import MesaCamera
from drivers.mesasr.coordinates import pixel_rays
from drivers.mesasr.library import find_library, load_library
from drivers.settings import CameraSettings

COMPILER = shutil.which("gcc") or shutil.which("cc")
SOURCE = Path(__file__).with_name("mesasr_stub.c")

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Compiles the stub; each build is made once."""
    made: dict[tuple[str, ...], Path] = {}

    def compile_stub(*macros: str, name: str = "libmesasr.so") -> Path:
        key = (name, *macros)
        if key not in made:
            path = tmp_path_factory.mktemp("stub") / name
            command = [COMPILER, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o", path, SOURCE, "-lm"]
            subprocess.run([*command, *(f"-D{macro}" for macro in macros)], check=True)
            made[key] = path
        return made[key]

    return compile_stub


@pytest.fixture
def stub(build):
    """The usual build, with its levers at rest; at the end, no wrong handle may have been seen."""
    levers = ctypes.CDLL(str(build()))
    levers.stub_plug(1)
    levers.stub_fail_acquires(0)
    levers.stub_leave_acquires(0)
    levers.stub_firmware(0x97)
    levers.stub_refuse_frequency(0)
    levers.stub_last_began.restype = ctypes.c_int64
    yield levers
    assert levers.stub_wrong_handles() == 0


class StubClock:
    """The time of a stub library."""

    def __init__(self, path: Path) -> None:
        self._levers = ctypes.CDLL(str(path))
        self._levers.stub_now.restype = ctypes.c_int64

    def now(self) -> int:
        return 10**9 + self._levers.stub_now()

    def sleep(self, seconds: float) -> None:
        self._levers.stub_pass(ctypes.c_int64(max(0, round(seconds * 1e9))))


def camera(path: Path, **options: object) -> MesaCamera:
    return MesaCamera(MesaCamera.Options(library=path, **options), StubClock(path))


@pytest.mark.parametrize("macros", [(), ("PACKED",), ("OLD",)])
def test_frames_from_every_build(build, macros):
    with camera(build(*macros)) as cam:
        cam.start()
        for number in (2, 3):  # the first one after settings is thrown away
            frame = cam.grab()
            expected = 4 * (np.arange(144 * 176) % 4096) + number * 4096
            expected[1234] = 0  # without confidence
            np.testing.assert_array_equal(frame.counts.ravel(), expected)
            assert np.all(frame.amplitude == 1097)
        assert frame.sequence == 2
        assert frame.ambiguity_range == 5.0
        assert cam.capabilities.serial == "4000002F"
        assert cam.capabilities.model == "SR4000"
        assert cam.settings.integration_time == pytest.approx(10e-3)  # 0.3 ms + 97 · 0.1 ms, as it was found


def test_images_are_fetched_anew_after_a_mode_change(build, stub):
    with camera(build()) as cam:
        cam.start()
        before = cam.grab()
        cam.settings = cam.settings.model_copy(update={"amplitude_mode": "gray"})
        assert stub.stub_mode() == 0x511
        after = cam.grab()
    assert before.amplitude_mode == "linear"
    assert after.amplitude_mode == "gray"
    assert np.all(before.amplitude == 1097)
    assert np.all(after.amplitude == 500)


def test_metrology_mode_and_auto_exposure_off(build, stub):
    with camera(build()):
        assert stub.stub_mode() == 0x501  # software trigger, confidence, fixed pattern; no filter, no gray
        assert stub.stub_auto_min() == 255
    with camera(build(), auto_exposure=True, acquire_mode=0x05):
        assert stub.stub_mode() == 0x05
        assert stub.stub_auto_min() == 1


def test_settings_reach_the_camera(build, stub):
    with camera(build()) as cam:
        cam.settings = CameraSettings(
            integration_time=5.04e-3, modulation_frequency=29e6, amplitude_threshold=700
        )
        assert stub.stub_integration() == 47
        assert stub.stub_threshold() == 700
        assert cam.settings.integration_time == pytest.approx(5e-3)
        cam.start()
        assert cam.grab().ambiguity_range == pytest.approx(150 / 29)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"integration_time": 30e-3}, r"30 ms: it takes 0\.3 to 25\.8 ms"),
        ({"modulation_frequency": 20e6}, r"20 MHz: it takes 30, 15, 29, 31, 14.5, 15.5 MHz"),
        ({"frame_rate": 60.0}, r"60 frames/s"),
    ],
)
def test_impossible_settings_are_refused(build, stub, change, message):
    with camera(build()) as cam:
        in_force = cam.settings
        with pytest.raises(InitialisationError, match=message):
            cam.settings = in_force.model_copy(update=change)
        assert cam.settings == in_force
    assert stub


def test_a_frequency_that_is_silently_refused_is_noticed(build, stub):
    stub.stub_refuse_frequency(1)
    with camera(build()) as cam:
        other = cam.settings.model_copy(update={"modulation_frequency": 31e6})
        with pytest.raises(OperationError, match="asked for 31 MHz, the camera stays at 30 MHz"):
            cam.settings = other


@pytest.mark.parametrize("macros", [(), ("VERSION=10", "Y2008")])
def test_numbering_of_frequencies_follows_the_version(build, macros):
    path = build("PRODUCT=0x0074", *macros, name="libmesasr.so" if not macros else "libusbSR.so")
    with camera(path) as cam:
        assert cam.capabilities.model == "SR3000"
        assert cam.settings.modulation_frequency == 20e6  # number 3
        cam.settings = cam.settings.model_copy(update={"modulation_frequency": 40e6})
        cam.settings = cam.settings.model_copy(update={"modulation_frequency": 20e6})
        assert cam.settings.ambiguity_range == 7.5


def test_numbers_that_are_not_documented_are_not_guessed(build):
    with pytest.raises(InitialisationError, match=r"version 1\.0\.9\.706.*from 1\.0\.10 on"):
        camera(build("VERSION=9")).open()
    with pytest.raises(NotAvailableError, match="of 2008 or later: it lacks SR_SetMode"):
        camera(build("Y2007", name="libusbSR.so")).open()
    with camera(build("VERSION=10", "Y2008")) as cam:
        other = cam.settings.model_copy(update={"modulation_frequency": 29e6})
        with pytest.raises(InitialisationError, match="does not know it"):
            cam.settings = other


@pytest.mark.parametrize("frequency", [14.5e6, 15.5e6])
def test_all_frequencies_of_an_sr4000(build, stub, frequency):
    with camera(build()) as cam:
        cam.settings = cam.settings.model_copy(update={"modulation_frequency": frequency})
        assert cam.settings.ambiguity_range == pytest.approx(150e6 / frequency)
    assert stub


def test_an_sr2_has_one_frequency_and_no_auto_exposure(build):
    path = build("PRODUCT=0x0071")
    with camera(path, model="SR2B") as cam:
        assert cam.settings.modulation_frequency == 20e6
        with pytest.raises(InitialisationError, match="30 MHz: it takes 20 MHz"):
            cam.settings = cam.settings.model_copy(update={"modulation_frequency": 30e6})
    with pytest.raises(InitialisationError, match="SR2B cannot be given auto exposure: no values are doc"):
        camera(path, model="SR2B", auto_exposure=True).open()


def test_an_sr4500_is_named(build, stub):
    with camera(build("OLD"), model="SR4500") as cam:
        assert cam.capabilities.model == "SR4500"
        assert cam.calibration == sr4500_calibration()
        assert cam.settings.integration_time == pytest.approx(10e-3)
    with pytest.raises(InitialisationError, match=r"SR9 does not tell the model: .*SR4500"):
        camera(build(), model="SR9").open()
    assert stub


def test_what_the_camera_itself_can_reject_and_expose_twice(build, stub):
    with camera(build(), saturation_threshold=40_000, dual_integration=50) as cam:
        assert (stub.stub_saturation(), stub.stub_dual()) == (40_000, 50)
        cam.start()
        frame = cam.grab()
        twice = cam.exposure_start(frame)
    with camera(build()) as cam:
        cam.start()
        frame = cam.grab()
        assert frame.timestamp - frame.timestamp_uncertainty - twice > 0
    stub.stub_firmware(0x6A)
    with pytest.raises(InitialisationError, match="firmware is 0x6a, needed is 0x73"):
        camera(build(), dual_integration=50).open()
    with pytest.raises(InitialisationError, match="has no SR_SetSaturationThreshold"):
        camera(build("OLD"), saturation_threshold=1).open()


def test_a_short_time_allowed_does_not_shorten_the_library_s_timeout(build, stub):
    with camera(build()) as cam:
        cam.start()
        cam.settings = cam.settings.model_copy(update={"integration_time": 25.8e-3})
        cam.grab(timeout=0.104)
        assert stub.stub_timeout() >= 4 * (25.8 + 4.6) + 250
        sequence = cam.grab().sequence
        for _ in range(6):
            with pytest.raises(DeviceTimeoutError, match="shorter than an exposure"):
                cam.grab(timeout=0.1)
        assert cam.grab().sequence == sequence + 1


def test_settings_hold_from_the_first_frame_that_is_given(build, stub):
    with camera(build()) as cam:
        cam.start()
        for value in (3e-3, 7e-3, 2e-3):
            cam.settings = cam.settings.model_copy(update={"integration_time": value})
            frame = cam.grab()
            assert frame.amplitude[0, 0] - 1000 == round((frame.integration_time - 0.3e-3) / 0.1e-3)
    assert stub


def test_auto_exposure_gives_each_frame_its_own_time(build, stub):
    with camera(build(), auto_exposure=True) as cam:
        cam.start()
        frames = [cam.grab() for _ in range(5)]
    times = [frame.integration_time for frame in frames]
    assert times == sorted(set(times))
    for frame in frames:
        assert frame.amplitude[0, 0] - 1000 == round((frame.integration_time - 0.3e-3) / 0.1e-3)
    assert stub


def test_after_a_failure_no_earlier_frame_is_taken_for_a_later_one(build, stub):
    with camera(build()) as cam:
        cam.start()
        cam.grab()
        stub.stub_leave_acquires(1)
        with pytest.raises(OperationError, match="did not get"):
            cam.grab()
        with pytest.raises(DeviceLostError, match="it was an earlier one; the camera must be opened anew"):
            cam.grab()
        cam.close()
        cam.open()
        cam.start()
        asked = cam.clock.now()
        cam.grab()
        assert 10**9 + stub.stub_last_began() >= asked


def test_failed_frames_are_gaps_and_many_of_them_a_lost_camera(build, stub):
    stub.stub_fail_acquires(2)
    with camera(build()) as cam:
        cam.start()
        for _ in range(2):
            with pytest.raises(OperationError, match=r"SR_Acquire.*did not get requested bytes"):
                cam.grab()
        assert cam.grab().sequence == 3
        assert cam.grab().counts[0, 1] == 4 + 4 * 4096  # two were thrown away: after settings, after failures
        stub.stub_fail_acquires(9)
        for _ in range(4):
            with pytest.raises(OperationError):
                cam.grab()
        with pytest.raises(DeviceLostError, match="5 times in a row"):
            cam.grab()


def test_after_replugging_settings_are_applied_again(build, stub):
    cam = camera(build())
    cam.open()
    cam.settings = cam.settings.model_copy(update={"integration_time": 2e-3, "amplitude_threshold": 9})
    cam.start()
    stub.stub_plug(0)
    for _ in range(4):
        with pytest.raises(OperationError):
            cam.grab()
    with pytest.raises(DeviceLostError):
        cam.grab()
    cam.close()
    with pytest.raises(NotAvailableError, match=r"no camera on USB.*no device opened"):
        cam.open()
    stub.stub_plug(1)
    cam.open()
    assert (stub.stub_integration(), stub.stub_threshold()) == (17, 9)
    cam.start()
    assert cam.grab().integration_time == pytest.approx(2e-3)
    cam.close()


def test_serial_selects(build, stub):
    with camera(build(), serial="4000002F") as cam:
        assert cam.capabilities.serial == "4000002F"
    with pytest.raises(NotAvailableError, match="with serial 12"):
        camera(build(), serial="12").open()
    assert stub


def test_rays_give_the_lens(build, stub):
    with camera(build()) as cam:
        rays = pixel_rays(cam._library, cam._handle, (144, 176))
        known = cam.calibration
    assert rays[0, 0, 0] < 0  # the left edge looks left
    assert rays[0, 0, 1] < 0  # the top edge looks up
    assert known.intrinsics.fx == pytest.approx(252.36, abs=0.01)
    assert known.intrinsics.cx == pytest.approx(87.5, abs=0.01)
    assert known.intrinsics.cy == pytest.approx(71.5, abs=0.01)
    np.testing.assert_allclose(known.distortion[:2], (-0.918, 0.668), atol=2e-3)
    assert known.noise is not None
    assert "rays of the vendor's library, residual 0.0" in known.source
    assert stub


def test_without_rays_the_nominal_optics_are_used(build):
    with camera(build("OLD")) as cam:
        assert cam.calibration == sr4000_calibration()
        assert cam.capabilities.model == "SR4000"


def test_missing_functions_are_told(build):
    with pytest.raises(InitialisationError, match="no SR_SetAutoExposure"):
        camera(build("OLD"), auto_exposure=True).open()
    with pytest.raises(NotAvailableError, match="cannot open cameras on Ethernet"):
        camera(build(), address="192.0.2.1").open()


def test_messages_of_the_library_are_logged(build, stub, caplog):
    load_library(build())
    with caplog.at_level(logging.INFO, logger="drivers.mesasr.library"):
        stub.stub_say(b"Downloading SR3k_ipm.bit", 1)
    assert "libMesaSR: Downloading SR3k_ipm.bit" in caplog.text


def test_the_exposure_lies_between_request_and_end(build, stub):
    with camera(build()) as cam:
        cam.start()
        cam.grab()
        before = cam.clock.now()
        frame = cam.grab()
        after = cam.clock.now()
        start = cam.exposure_start(frame)
    # the software trigger: two of the four samples of 10 ms come before the middle
    assert frame.timestamp == before + 20_000_000
    assert frame.timestamp_uncertainty <= 1
    assert after == before + 40_000_000  # and the stub needs no readout, which may take 18.4 ms
    assert start == before - 9_200_000 - frame.timestamp_uncertainty
    assert stub


def test_nothing_is_loaded_from_the_current_folder(build, tmp_path, monkeypatch):
    shutil.copy(build(), tmp_path / "libmesasr.so")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NotAvailableError, match=r"Havex"):
        find_library()
    with pytest.raises(InitialisationError, match="absolute path"):
        find_library(Path("libmesasr.so"))
    assert find_library(tmp_path / "libmesasr.so") == (tmp_path / "libmesasr.so").resolve()


def test_another_library_is_refused(tmp_path):
    text = tmp_path / "libmesasr.so"
    text.write_text("no library")
    with pytest.raises(NotAvailableError, match="cannot be loaded"):
        load_library(text)
    source = tmp_path / "other.c"
    source.write_text("int SR_Acquire(void *camera) { return 0; }")
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", tmp_path / "other.so", source], check=True)
    with pytest.raises(NotAvailableError, match="no libMesaSR of 2008 or later: it lacks SR_OpenUSB"):
        load_library(tmp_path / "other.so")
