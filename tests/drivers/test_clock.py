from drivers.clock import SystemClock

SECOND = 1_000_000_000


class Hands:
    """A wall clock that can be set, and one that cannot."""

    def __init__(self) -> None:
        self.steady, self.ahead = 5 * SECOND, 10**18

    def wall(self) -> int:
        return self.steady + self.ahead


def test_a_clock_that_is_set_back_corrected_and_set_again_is_followed_but_never_jumps() -> None:
    hands = Hands()
    clock = SystemClock(hands.wall, lambda: hands.steady)
    started = clock.now()
    for moved in (-3600 * SECOND, 86_400 * SECOND, 0):
        hands.ahead = 10**18 + moved
        hands.steady += SECOND
        assert clock.correction() == moved
        assert clock.now() + clock.correction() == hands.wall()
    assert clock.now() - started == 3 * SECOND


def test_what_reading_two_clocks_costs_is_no_correction() -> None:
    hands = Hands()
    clock = SystemClock(hands.wall, lambda: hands.steady)
    hands.ahead += 2_000_000
    assert clock.correction() == 0
    assert SystemClock().correction() == 0
