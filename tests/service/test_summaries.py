"""What is kept and said of each map."""

import logging
from collections.abc import Callable

import pytest

from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.sinks.summaries import Summaries


def test_every_map_is_kept_and_the_log_gets_one_a_second(
    fused: Callable[[int], FusedMap], caplog: pytest.LogCaptureFixture
) -> None:
    now = [0.0]
    summaries = Summaries(clock=lambda: now[0])
    with caplog.at_level(logging.INFO, "service"):
        for number in range(40):
            now[0] = number / 20  # as a stream gives them
            summaries.take(MapFused(fused(number), None))
    assert [kept.report.burst for kept in summaries.kept] == list(range(40))
    assert [line.split(":")[0] for line in caplog.messages] == ["burst 0", "burst 20"]
