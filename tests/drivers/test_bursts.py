"""What a burst is."""

import pytest
from made_frames import PERIOD, make_frame

from drivers.bursts import LONGEST_PAUSE, BurstCutter, ExpectedFrames

SHAPE = (4, 6)
HOUR = 3600 * 10**9


def frame(number, burst=0, pose=None, later=0, **changes):
    return make_frame(
        number, burst=burst, pose=pose, shape=SHAPE, timestamp=10**18 + number * PERIOD + later, **changes
    )


def lengths(frames, number=None, calibrations=None):
    cutter, bursts = BurstCutter(number), []
    for index, found in enumerate(frames):
        calibration = None if calibrations is None else calibrations[index]
        if cutter.begins(found, found.shape, calibration):
            bursts.append(0)
        bursts[-1] += 1
    return bursts


def test_frames_of_one_id_belong_together():
    assert lengths([frame(k, burst=k // 3) for k in range(8)]) == [3, 3, 2]


def test_frames_without_an_id_are_cut_by_number():
    frames = [frame(k, burst=None) for k in range(7)]
    assert lengths(frames, 3) == [3, 3, 1]
    assert lengths(frames) == [7]
    assert lengths([frame(0), frame(1, burst=None), frame(2, burst=None)], 5) == [1, 2]


@pytest.mark.parametrize(
    "second",
    [
        {"later": HOUR},
        {"later": -HOUR},
        {"sequence": 100},
        {"pose": 0},
        {"modulation_frequency": 30e6},
        {"ambiguity_range": 5.0},
        {"integration_time": None},
    ],
)
def test_what_differs_begins_a_burst_though_the_id_is_the_same(second):
    first = [frame(k, pose=k) for k in range(3)]
    rest = [frame(k, **{"pose": k} | second) for k in range(3, 4)]
    assert lengths(first + rest) == [3, 1]


def test_another_size_and_another_calibration_begin_a_burst():
    odd = make_frame(2, burst=0, shape=(5, 5), timestamp=10**18 + 2 * PERIOD)
    assert lengths([frame(0), frame(1), odd]) == [2, 1]
    assert lengths([frame(k) for k in range(4)], calibrations=["a", "a", "b", "b"]) == [2, 2]


def test_drops_and_pauses_do_not_end_a_burst():
    frames = [frame(0, pose=0), frame(5, pose=1, later=LONGEST_PAUSE // 2), frame(6, pose=7, sequence=10**8)]
    assert lengths(frames) == [3]
    assert lengths([frame(0), frame(1, later=-2 * 10**9), frame(2, integration_time=0.01)]) == [3]


def test_less_than_one_frame_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        BurstCutter(0)


def test_a_burst_should_have_as_many_frames_as_the_fullest_of_its_scan():
    expected = ExpectedFrames(15)
    first = [
        [frame(k, burst=0, pose=k) for k in range(6)],
        [frame(10 + k, burst=1, pose=k) for k in range(4)],
    ]
    second = [frame(k, burst=0, pose=k) for k in range(3)]
    assert [expected.of(burst) for burst in [*first, second]] == [6, 6, 3]
    assert expected.of([frame(9, burst=1, pose=8)]) == 9
    assert expected.of([frame(10, burst=None)]) == 15


def test_a_burst_should_have_as_many_frames_as_planned():
    expected = ExpectedFrames(15, planned=9)
    assert expected.of([frame(0, burst=0, pose=0)]) == 9
