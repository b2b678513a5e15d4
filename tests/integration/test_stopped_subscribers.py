"""A subscriber that stops reading, as with Ctrl-Z: nobody else notices, and the service ends in time."""

import signal
import time
from pathlib import Path

import pytest
from daemons import daemon, ear, reader

pytestmark = pytest.mark.faults

GAP, STOP = 4.5, 6.0
"""Seconds: a stuck link that others wait for costs 5, and at the end 10; without a load it is 0.3, and 2."""


@pytest.mark.parametrize("seconds", [10.5, 11.5, 12.0, 12.5])
def test_it_ends_in_time_while_zenoh_gives_a_stopped_subscriber_up(tmp_path: Path, seconds: float) -> None:
    with daemon(tmp_path) as service, reader(service.endpoint) as stopped:
        assert stopped.stdout is not None
        assert stopped.stdout.readline() == b"map\n"
        stopped.send_signal(signal.SIGSTOP)
        time.sleep(seconds)  # what is withdrawn then blocks for up to ten seconds
        assert service.stop() < STOP, service.log


def test_a_stopped_subscriber_holds_up_neither_others_nor_the_end(tmp_path: Path) -> None:
    with daemon(tmp_path) as service, ear(service.endpoint) as other, reader(service.endpoint) as stopped:
        other.hears("fused/depth")
        assert stopped.stdout is not None
        assert stopped.stdout.readline() == b"map\n"
        stopped.send_signal(signal.SIGSTOP)
        since = time.monotonic()
        time.sleep(15)  # past the 5 s after which Zenoh closes a link by itself, and the lease of 10 s
        assert other.longest_gap("camera/distance", since) < GAP
        assert other.longest_gap("status", since) < GAP
        assert other.longest_gap("fused/report", since) < GAP
        assert other.status["drops"]["published"] == 0
        stopped.send_signal(signal.SIGCONT)
        for _ in range(20):  # those that were under way, and fresh ones
            assert stopped.stdout.readline() == b"map\n"
        stopped.send_signal(signal.SIGSTOP)
        other.hears("fused/depth", more=20)
        assert service.stop() < STOP, service.log
        assert "what it missed is lost" in service.log
