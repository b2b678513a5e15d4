"""Sinks are apart: one that raises, hangs or is slow costs the others nothing, and is shown and restarted."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from service.errors import EncodingError, SinkError
from service.messages.events import Event, Logged, StateChanged
from service.sinks.bus import Bus
from service.sinks.patience import Patience
from service.sinks.sink import Room, Sink

QUICK = Patience(held=0.4, hang=0.4, restart=0.02)


class Keeps(Sink):
    """Keeps what it is given."""

    def __init__(self, kept: list[Event], opened: list[int]) -> None:
        super().__init__()
        self.kept, self.opened = kept, opened

    def open(self) -> None:
        self.opened.append(1)

    def take(self, event: Event) -> None:
        self.kept.append(event)


class Raises(Keeps):
    def take(self, event: Event) -> None:
        super().take(event)
        raise RuntimeError("of no use")


class Hangs(Keeps):
    """On its first event, until it is let go; then it would keep what comes."""

    let_go = threading.Event()

    def take(self, event: Event) -> None:
        if not self.kept:
            self.kept.append(event)
            self.let_go.wait(30)
            if self.abandoned.is_set():
                return
        super().take(event)


class Slow(Keeps):
    room = Room(4, 1 << 20)

    def take(self, event: Event) -> None:
        time.sleep(0.02)
        super().take(event)


class CannotEncode(Keeps):
    def take(self, event: Event) -> None:
        super().take(event)
        raise EncodingError("Event cannot be encoded: no such thing")


class Bench:
    """A bus with sinks, each with what it was given."""

    def __init__(self, *, lossless: bool = False) -> None:
        self.bus = Bus(lossless=lossless, patience=QUICK)
        self.kept: dict[str, list[Event]] = {}
        self.opened: dict[str, list[int]] = {}

    def add(self, name: str, kind: type[Keeps]) -> None:
        kept, opened = self.kept.setdefault(name, []), self.opened.setdefault(name, [])
        self.bus.add(name, lambda: kind(kept, opened))

    def state(self, name: str):  # type: ignore[no-untyped-def]
        return next(state for state in self.bus.states if state.name == name)

    def until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + 30
        while not condition():
            assert time.monotonic() < deadline, "timed out"
            self.bus.watch()
            time.sleep(0.005)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    Hangs.let_go.set()
    made.bus.close(5)
    Hangs.let_go.clear()


def emitted(bench: Bench, count: int) -> list[Event]:
    events = [Event() for _ in range(count)]
    for event in events:
        bench.bus.emit(event)
    return events


@pytest.mark.parametrize("kind", [Raises, Hangs, Slow, CannotEncode])
@pytest.mark.parametrize("lossless", [False, True])
def test_a_faulty_sink_costs_the_others_nothing(kind: type[Keeps], lossless: bool) -> None:
    bench = Bench(lossless=lossless)
    try:
        bench.add("before", Keeps)
        bench.add("faulty", kind)
        bench.add("after", Keeps)
        events = emitted(bench, 30)
        bench.until(lambda: len(bench.kept["before"]) == len(bench.kept["after"]) == 30)
        assert bench.kept["before"] == bench.kept["after"] == events
        assert bench.state("after").dropped == bench.state("before").dropped == 0
    finally:
        Hangs.let_go.set()
        bench.bus.close(5)
        Hangs.let_go.clear()


def test_one_that_raises_is_counted_shown_and_started_again(bench: Bench) -> None:
    bench.add("faulty", Raises)
    emitted(bench, 3)
    bench.until(lambda: bench.state("faulty").faults >= 3)
    state = bench.state("faulty")
    assert (state.taken, state.dropped, state.error) == (0, 3, "of no use")
    assert len(bench.opened["faulty"]) >= 3
    bench.bus.close(5)
    assert bench.bus.losses == ["faulty: 3 events lost (of no use)"]


def test_one_that_hangs_is_given_up_and_what_it_does_later_has_no_effect(bench: Bench) -> None:
    bench.add("faulty", Hangs)
    emitted(bench, 5)
    bench.until(lambda: bench.state("faulty").abandoned == 1)
    bench.until(lambda: len(bench.kept["faulty"]) == 5)
    assert bench.state("faulty").state == "running"
    Hangs.let_go.set()
    emitted(bench, 2)
    bench.until(lambda: len(bench.kept["faulty"]) == 7)
    time.sleep(0.05)
    assert len(bench.kept["faulty"]) == 7
    assert bench.state("faulty").dropped == 1


def test_one_that_hangs_again_and_again_waits_until_what_hangs_comes_back(bench: Bench) -> None:
    class AlwaysHangs(Keeps):
        def take(self, event: Event) -> None:
            Hangs.let_go.wait(30)
            super().take(event)

    bench.add("faulty", AlwaysHangs)
    emitted(bench, 5)
    bench.until(lambda: bench.state("faulty").state == "failed")
    assert bench.state("faulty").abandoned == 3
    assert (bench.state("faulty").error or "").startswith("it hung 3 times; it goes on once")
    emitted(bench, 1)
    assert bench.state("faulty").dropped == 6
    Hangs.let_go.set()  # the share is there again
    bench.until(lambda: bench.state("faulty").state == "running")
    taken = bench.state("faulty").taken
    emitted(bench, 3)
    bench.until(lambda: bench.state("faulty").taken == taken + 3)
    assert bench.state("faulty").dropped == 6


def test_one_that_hangs_for_a_while_now_and_then_is_never_given_up_for_good(bench: Bench) -> None:
    class HangsForAWhile(Keeps):
        def take(self, event: Event) -> None:
            self.abandoned.wait(30)
            super().take(event)

    bench.add("faulty", HangsForAWhile)
    for count in range(1, 6):
        emitted(bench, 1)
        bench.until(lambda count=count: bench.state("faulty").abandoned == count)
        bench.until(lambda count=count: len(bench.kept["faulty"]) == count)
        assert bench.state("faulty").state != "failed"


def test_one_that_waits_with_a_limit_of_its_own_hangs_later(bench: Bench) -> None:
    class TakesItsTime(Keeps):
        slowest = 30.0

        def take(self, event: Event) -> None:
            Hangs.let_go.wait(2.5 * QUICK.hang)
            super().take(event)

    bench.add("patient", TakesItsTime)
    emitted(bench, 1)
    bench.until(lambda: bench.state("patient").taken == 1)
    assert bench.state("patient").abandoned == 0


def test_nobody_waits_for_what_hangs_when_all_is_closed(bench: Bench) -> None:
    class AlwaysHangs(Keeps):
        def take(self, event: Event) -> None:  # noqa: ARG002
            Hangs.let_go.wait(30)

    bench.add("faulty", AlwaysHangs)
    emitted(bench, 5)
    bench.until(lambda: bench.state("faulty").state == "failed")
    began = time.monotonic()
    bench.bus.close(25)
    assert time.monotonic() - began < 10
    assert (bench.state("faulty").state, bench.state("faulty").abandoned) == ("failed", 3)


def test_live_a_slow_one_loses_and_counts_and_nobody_waits(bench: Bench) -> None:
    bench.add("slow", Slow)
    began = time.monotonic()
    emitted(bench, 200)
    assert time.monotonic() - began < 1.0
    bench.until(lambda: bench.state("slow").waiting == 0)
    bench.bus.close(5)
    state = bench.state("slow")
    assert state.taken + state.dropped == 200
    assert state.dropped > 100


@pytest.mark.parametrize("lossless", [False, True])
def test_in_a_hurry_what_may_be_passed_over_is_not_worked_off(lossless: bool) -> None:
    class Pictures(Hangs):
        newest_suffice = True

    class AllMatter(Hangs): ...

    bench = Bench(lossless=lossless)
    for name, kind in (("pictures", Pictures), ("all", AllMatter)):
        bench.add(name, kind)
    try:
        emitted(bench, 5)
        bench.until(lambda: all(len(kept) == 1 for kept in bench.kept.values()))
        threading.Timer(0.1, Hangs.let_go.set).start()
        bench.bus.close(20, hurry=True)
    finally:
        Hangs.let_go.set()
        bench.bus.close(5)
        Hangs.let_go.clear()
    assert len(bench.kept["pictures"]) == 2, "the one at work, which it keeps twice"
    assert len(bench.kept["all"]) == 6
    assert bench.state("pictures").dropped == 4
    assert bench.bus.losses == (["pictures: 4 events lost"] if lossless else [])


@pytest.mark.parametrize("lossless", [False, True])
def test_live_one_that_the_newest_suffice_counts_the_others_as_no_loss(
    lossless: bool, caplog: pytest.LogCaptureFixture
) -> None:
    class Newest(Slow):
        newest_suffice = True

        def take(self, event: Event) -> None:
            self.abandoned.wait(QUICK.held * 2 if lossless else 0.05)
            super().take(event)

    bench = Bench(lossless=lossless)
    bench.add("newest", Newest)
    emitted(bench, 20)
    bench.bus.watch()
    bench.bus.close(20)
    assert bench.state("newest").dropped > 0
    assert bool(bench.bus.losses) == lossless
    assert ("events lost" in caplog.text) == lossless


def test_lossless_a_slow_one_is_waited_for() -> None:
    bench = Bench(lossless=True)
    bench.add("slow", Slow)
    events = emitted(bench, 40)
    bench.bus.close(30)
    assert bench.kept["slow"] == events
    assert bench.bus.losses == []


def test_lossless_one_that_holds_the_run_back_too_long_is_failed() -> None:
    class Stuck(Slow):
        def take(self, event: Event) -> None:  # noqa: ARG002
            Hangs.let_go.wait(30)

    bench = Bench(lossless=True)
    try:
        bench.add("stuck", Stuck)
        began = time.monotonic()
        emitted(bench, 20)
        assert 0.3 < time.monotonic() - began < 5
        assert bench.state("stuck").state == "failed"
        assert "held the run back" in (bench.state("stuck").error or "")
    finally:
        Hangs.let_go.set()
        bench.bus.close(5)
        Hangs.let_go.clear()
    assert bench.bus.losses[0].startswith("stuck: ")


def test_what_a_sink_may_cause_itself_never_waits_for_it() -> None:
    bench = Bench(lossless=True)
    release = threading.Event()

    class Waits(Slow):
        def take(self, event: Event) -> None:  # noqa: ARG002
            release.wait(30)

    bench.add("waits", Waits)
    began = time.monotonic()
    for _ in range(20):
        bench.bus.emit(Logged(None))  # type: ignore[arg-type]
    assert time.monotonic() - began < 0.3
    release.set()
    bench.bus.close(5)


def test_who_begins_later_is_told_what_lasts_and_nothing_twice(bench: Bench) -> None:
    bench.bus.emit(StateChanged("starting", "first"))
    latest = StateChanged("scanning", "second")
    bench.bus.emit(latest)
    bench.add("late", Keeps)
    (event,) = emitted(bench, 1)
    bench.until(lambda: len(bench.kept["late"]) == 2)
    assert bench.kept["late"] == [latest, event]


def test_sinks_come_and_go_while_it_runs(bench: Bench) -> None:
    bench.add("one", Keeps)
    with pytest.raises(SinkError, match="there is a sink 'one' already"):
        bench.add("one", Keeps)
    emitted(bench, 2)
    assert bench.bus.remove("one").taken == 2
    emitted(bench, 2)
    assert len(bench.kept["one"]) == 2
    with pytest.raises(SinkError, match="no sink 'one'"):
        bench.bus.remove("one")


@pytest.mark.parametrize("broken", ["__init__", "open"])
def test_what_somebody_elses_sink_raises_at_its_beginning_names_the_sink(bench: Bench, broken: str) -> None:
    def fail(*_: object) -> None:
        raise AttributeError("no such thing")

    kind = type("Broken", (Keeps,), {broken: fail})
    with pytest.raises(SinkError, match=r"sink 'broken' cannot begin: AttributeError: no such thing"):
        bench.add("broken", kind)
    assert bench.bus.states == ()


def test_what_opening_raises_is_raised_and_nothing_is_half_started(bench: Bench) -> None:
    class Refuses(Keeps):
        def open(self) -> None:
            raise SinkError("no such port")

    with pytest.raises(SinkError, match="no such port"):
        bench.add("refuses", Refuses)
    assert bench.bus.states == ()
    bench.bus.add("refuses", lambda: Refuses([], []), must_open=False)
    bench.until(lambda: bench.state("refuses").faults >= 2)
    assert bench.state("refuses").error == "no such port"
