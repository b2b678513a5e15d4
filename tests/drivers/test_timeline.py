"""When the frames of a recording are due, whatever its clock did."""

from dataclasses import replace
from itertools import pairwise

import pytest
from made_frames import PERIOD, make_bursts

from drivers import make_camera
from drivers.calibration import Mount
from drivers.clock import VirtualClock
from drivers.recording import RecordingWriter
from drivers.timeline import CUT, Gap, Timeline

SECOND = 10**9
NOW = 1_790_000_000 * SECOND


def test_frames_are_due_as_they_were_exposed():
    line = Timeline([5, 5 + SECOND, 5 + 3 * SECOND, 5 + 63 * SECOND])
    assert [line.due(frame) for frame in range(4)] == [0, SECOND, 3 * SECOND, 63 * SECOND]
    assert line.gaps == ()
    assert (line.duration, line.round) == (63 * SECOND, 65 * SECOND)
    assert [line.at(due) for due in (-1, 0, SECOND - 1, SECOND, 2 * SECOND, 99 * SECOND)] == [
        0,
        0,
        0,
        1,
        1,
        3,
    ]


@pytest.mark.parametrize(
    ("jump", "taken", "said"),
    [
        (NOW, CUT, "at frame 2 the clock goes on by 20717 days, 14:13:21"),
        (-3600 * SECOND, SECOND, "at frame 2 the clock goes back by 0:59:59"),
        (60 * SECOND, CUT, "at frame 2 the clock goes on by 0:01:01"),
        (-SECOND - 1, SECOND, "at frame 2 the clock goes back by 0:00:00"),
    ],
)
def test_a_clock_that_was_set_is_told_and_cut_short(jump, taken, said):
    line = Timeline([0, SECOND, 2 * SECOND + jump, 3 * SECOND + jump])
    assert [line.due(frame) for frame in range(4)] == [0, SECOND, SECOND + taken, 2 * SECOND + taken]
    assert line.gaps == (Gap(2, (SECOND + jump) / 1e9),)
    assert str(line.gaps[0]) == said


@pytest.mark.parametrize("timestamps", [[7], [7, 7], [9, 7]])
def test_the_shortest_recordings_have_a_round_too(timestamps):
    assert Timeline(timestamps).round > Timeline(timestamps).duration


@pytest.fixture
def set_clock(tmp_path):
    """Six frames; before the last three the clock was set from 1970 to today."""
    path = tmp_path / "set.mcap"
    with RecordingWriter(path, {}) as writer:
        for number, frame in enumerate(make_bursts(2, 3)):
            at = number * PERIOD + (NOW if number >= 3 else 0)
            writer.write_frame(replace(frame, timestamp=at), Mount())
    return path


def test_a_replay_does_not_stand_still_for_years(set_clock, caplog):
    clock = VirtualClock(0)
    with make_camera("replay", {"path": str(set_clock), "speed": 1.0}, clock) as camera:
        assert "at frame 3 the clock goes on by" in caplog.text
        camera.start()
        for _ in range(6):
            camera.grab()
        assert clock.now() == 4 * PERIOD + CUT


def test_rounds_of_a_loop_go_on_rising_within_the_times_there_are(set_clock):
    with make_camera("replay", {"path": str(set_clock), "loop": True}, VirtualClock(0)) as camera:
        camera.start()
        times = [camera.grab().timestamp for _ in range(600)]
    assert times == sorted(set(times))
    assert times[-1] < NOW + 1000 * SECOND
    numbers = times[6:12]
    assert [after - before for before, after in pairwise(numbers)] == [
        PERIOD,
        PERIOD,
        CUT,
        PERIOD,
        PERIOD,
    ]
