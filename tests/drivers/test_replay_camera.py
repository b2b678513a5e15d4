"""The camera that plays a recording: same frames, absolute schedule, nothing dropped."""

from dataclasses import replace

import pytest
from made_frames import PERIOD, assert_same_frame, make_bursts

from drivers import DeviceTimeoutError, EndOfRecordingError, InitialisationError, RecordingError, make_camera
from drivers.calibration import Mount
from drivers.clock import VirtualClock
from drivers.recording import RecordingWriter


@pytest.fixture(scope="module")
def frames():
    return make_bursts(2, 3)


@pytest.fixture(scope="module")
def path(frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "six.mcap"
    with RecordingWriter(path, {"camera_model": "SR3000", "camera_serial": "2f"}) as writer:
        for frame in frames:
            writer.write_frame(frame, Mount())
    return path


@pytest.fixture
def play(path):
    cameras = []

    def start(**options):
        clock = VirtualClock(1_000)
        camera = make_camera("replay", {"path": str(path), **options}, clock)
        cameras.append(camera)
        camera.open()
        camera.start()
        return camera, clock

    yield start
    for camera in cameras:
        camera.close()


def test_plays_the_very_frames_then_ends(play, frames):
    camera, clock = play()
    for frame in frames:
        assert_same_frame(camera.grab(), frame)
    assert clock.now() == 1_000  # without a speed nothing waits
    for _ in range(2):
        with pytest.raises(EndOfRecordingError, match=r"six\.mcap has been played to its end"):
            camera.grab()


def test_each_frame_is_due_at_its_own_time(play, frames):
    camera, clock = play(speed=2.0)
    for number in range(len(frames)):
        camera.grab()
        assert clock.now() == 1_000 + number * PERIOD // 2


def test_a_late_consumer_catches_up_and_loses_nothing(play, frames):
    camera, clock = play(speed=1.0)
    got = [camera.grab()]
    clock.sleep(2.5 * PERIOD / 1e9)
    got += [camera.grab(), camera.grab()]
    assert clock.now() == 1_000 + 5 * PERIOD // 2
    got += [camera.grab()]
    assert clock.now() == 1_000 + 3 * PERIOD
    assert [frame.sequence for frame in got] == [frame.sequence for frame in frames[:4]]


def test_timeout_keeps_the_frame_for_the_next_grab(play, frames):
    camera, clock = play(speed=0.01)
    camera.grab()
    with pytest.raises(DeviceTimeoutError, match=r"due in 1\.50 s"):
        camera.grab(timeout=0.5)
    assert clock.now() == 1_000 + 500_000_000
    assert_same_frame(camera.grab(timeout=1.6), frames[1])


def test_stop_pauses_and_open_rewinds(play, frames):
    camera, clock = play(speed=1.0)
    camera.grab()
    camera.stop()
    clock.sleep(100)
    camera.start()
    resumed = clock.now()
    assert_same_frame(camera.grab(), frames[1])
    camera.grab()
    assert clock.now() == resumed + PERIOD
    camera.close()
    camera.open()
    camera.start()
    assert_same_frame(camera.grab(), frames[0])


def test_a_loop_goes_on_rising(play, frames):
    camera, _ = play(loop=True)
    got = [camera.grab() for _ in range(3 * len(frames))]
    assert [frame.timestamp for frame in got] == [
        frames[0].timestamp + number * PERIOD for number in range(18)
    ]
    assert [frame.sequence for frame in got] == list(range(100, 118))
    assert [frame.burst for frame in got] == [number // 3 for number in range(18)]
    assert [frame.pose for frame in got] == [number % 3 for number in range(18)]
    assert (got[6].counts == frames[0].counts).all()


def test_says_what_it_plays(play):
    camera, _ = play()
    known = camera.capabilities
    assert (known.source, known.carries_pose, known.shape) == ("replay", True, (144, 176))
    assert (known.model, known.serial) == ("SR3000", "2f")
    assert camera.settings.integration_time == 0.003
    assert camera.settings.modulation_frequency == 20e6
    with pytest.raises(RecordingError, match="holds no calibration"):
        _ = camera.calibration


def test_settings_stay_as_recorded(play):
    camera, _ = play()
    camera.settings = camera.settings.model_copy(update={"integration_time": 0.030})
    assert camera.settings.integration_time == 0.003


def test_what_cannot_be_played_is_refused_on_open(tmp_path):
    with pytest.raises(InitialisationError, match=r"options of backend 'replay': path"):
        make_camera("replay", {})
    with pytest.raises(InitialisationError, match=r"speed"):
        make_camera("replay", {"path": "x.mcap", "speed": 0})
    (tmp_path / "x.mcap").write_bytes(b"not at all")
    camera = make_camera("replay", {"path": str(tmp_path / "x.mcap")})
    with pytest.raises(RecordingError, match="is not MCAP"):
        camera.open()
    assert not camera.is_open


YEARS = 56 * 365 * 24 * 3600 * 10**9


def jumping(path, jump):
    """Six frames; the clock is set before the fourth."""
    start = 10**18 + YEARS
    with RecordingWriter(path) as writer:
        for number, frame in enumerate(make_bursts(2, 3)):
            at = start + number * PERIOD + (jump if number >= 3 else 0)
            writer.write_frame(replace(frame, timestamp=at), Mount())
    return path
