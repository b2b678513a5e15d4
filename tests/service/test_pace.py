"""The capture waits for a fusion that is slower, and for no longer."""

from statistics import median

import pytest

from service.capture.pace import Pace


class Rig:
    """Captures and fuses, each in its time; the fusion takes one burst after the other."""

    def __init__(self, capturing: float, fusing: float) -> None:
        self.now = 100.0
        self.pace = Pace(lambda: self.now)
        self.capturing, self.fusing = capturing, fusing
        self.ends: list[float] = []
        self.late: list[float] = []

    def burst(self, kind: str = "usual") -> float:
        """Capture one when the pace says so; how long that was waited for."""
        done = self.now
        while (left := self.pace.wait()) > 1e-9:
            self.elapse(min(0.05, left))
        wait = self.now - done
        self.elapse(self.capturing)
        self.pace.captured(self.capturing, kind)
        begin = max(self.now, self.ends[-1] if self.ends else self.now)
        self.ends.append(begin + self.fusing)
        self.late.append(self.ends[-1] - self.now)
        return wait

    def elapse(self, seconds: float) -> None:
        """Let time go by, in which bursts are fused."""
        end = self.now + seconds
        for one in [one for one in self.ends if self.now < one <= end]:
            self.now = one
            self.pace.fused()
        self.now = end


def test_a_fusion_that_is_faster_holds_nothing_back() -> None:
    rig = Rig(capturing=1.0, fusing=0.6)
    assert [rig.burst() for _ in range(10)] == [0.0] * 10
    assert rig.late == pytest.approx([0.6] * 10)


def test_bursts_come_as_fast_as_a_slower_fusion_takes_them_and_none_waits() -> None:
    rig = Rig(capturing=1.0, fusing=2.5)
    waits = [rig.burst() for _ in range(20)]
    assert waits[5:] == pytest.approx([1.5] * 15)
    assert rig.late[5:] == pytest.approx([2.5] * 15)


def test_where_the_fusion_takes_now_more_now_less_a_burst_waits_for_nothing_as_a_rule() -> None:
    rig = Rig(capturing=1.0, fusing=2.5)
    waited = []
    for number in range(60):
        rig.fusing = (2.4, 2.6, 2.5, 2.55, 2.45, 2.6, 2.4)[number % 7]
        rig.burst()
        waited.append(rig.late[-1] - rig.fusing)
    assert median(waited[5:]) < 1e-9
    assert rig.ends[-1] - rig.ends[5] < 54 * 2.6


def test_few_wait_for_a_first_one_that_takes_long() -> None:
    rig = Rig(capturing=1.0, fusing=6.0)
    for _ in range(6):
        rig.burst()
    captured = [end - late for end, late in zip(rig.ends, rig.late, strict=True)]
    assert sum(one <= rig.ends[0] for one in captured) <= 3


def test_one_that_was_disturbed_does_not_count() -> None:
    rig = Rig(capturing=1.0, fusing=0.6)
    for _ in range(5):
        rig.burst()
    rig.fusing = 9.0
    rig.burst()
    rig.fusing = 0.6
    rig.elapse(20.0)
    assert [rig.burst() for _ in range(5)] == [0.0] * 5


def test_while_one_takes_far_longer_than_others_at_most_one_waits() -> None:
    rig = Rig(capturing=1.0, fusing=2.5)
    for number in range(40):
        rig.fusing = 20.0 if number % 8 == 7 else 2.5
        rig.burst()
        assert sum(end > rig.now for end in rig.ends) <= 2


def test_one_that_is_done_sooner_than_others_is_followed_at_once() -> None:
    rig = Rig(capturing=1.0, fusing=5.0)
    for _ in range(6):
        rig.burst()
    rig.elapse(20.0)
    rig.fusing = 2.0
    rig.burst()
    assert rig.burst() == pytest.approx(2.0, abs=0.05)


def test_other_settings_are_learned_anew() -> None:
    rig = Rig(capturing=1.0, fusing=5.0)
    for _ in range(6):
        rig.burst("slow")
    assert rig.pace.wait() > 3.0
    rig.elapse(20.0)
    rig.fusing = 0.1
    rig.burst("fast")
    assert rig.burst("fast") == 0.0


def test_a_burst_that_gave_way_is_not_waited_for() -> None:
    now = 0.0
    pace = Pace(lambda: now)
    for _ in range(2):
        pace.captured(1.0, "usual")
        now += 3.0
        pace.fused()
    pace.captured(1.0, "usual")
    pace.captured(1.0, "usual")
    assert pace.wait() == pytest.approx(5.0)
    pace.dropped()
    assert pace.wait() == pytest.approx(2.0)
