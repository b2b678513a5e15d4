"""A second process stands ready for the one that fuses, and takes its place."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from jobs_to_fuse import SETTINGS, job, map_of

from service.fusion.local import LocalExecutor


@pytest.fixture
def executor() -> Iterator[LocalExecutor]:
    """One that has a spare process."""
    with LocalExecutor(SETTINGS, spare=True) as executor:
        executor.ready.result(120)
        assert executor.spare_pid is None, "it would have made the first maps wait"
        for number in range(3):
            map_of(executor, job(number))
        spare_of(executor)
        yield executor


def spare_of(executor: LocalExecutor) -> int:
    end = time.monotonic() + 120
    while (pid := executor.spare_pid) is None:
        assert time.monotonic() < end, "there is no spare one"
        time.sleep(0.02)
    return pid


def test_it_takes_the_place_of_one_that_was_killed_and_another_is_made(executor: LocalExecutor) -> None:
    spare = spare_of(executor)
    assert executor.pid is not None
    os.kill(executor.pid, signal.SIGKILL)
    assert map_of(executor, job(3)).report.burst == 3
    assert executor.pid == spare
    assert executor.state.restarts == 1
    for number in range(3):
        map_of(executor, job(number))
    assert spare_of(executor) != spare


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_one_that_does_not_answer_any_more_is_passed_over(executor: LocalExecutor, number: int) -> None:
    spare = spare_of(executor)
    os.kill(spare, number)
    assert executor.pid is not None
    os.kill(executor.pid, signal.SIGKILL)
    assert map_of(executor, job(3)).report.burst == 3
    assert executor.pid != spare
    assert not Path(f"/proc/{spare}").exists()


def test_both_end_with_the_executor(executor: LocalExecutor) -> None:
    processes = [executor.pid, spare_of(executor)]
    executor.close()
    assert not [pid for pid in processes if Path(f"/proc/{pid}").exists()]
