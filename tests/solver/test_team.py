"""Threads that walk a loop together, and what becomes of the others where one fails."""

from collections.abc import Iterator

import numba
import numpy as np
import pytest

from solver.kernels.barrier import meet, take
from solver.runtime import team

if numba.config.NUMBA_NUM_THREADS == 1:
    pytest.skip("one thread is no team", allow_module_level=True)


@numba.njit(nogil=True)
def turns(rank, size, barrier, rounds, fails, out):  # type: ignore[no-untyped-def]
    """Each thread in turn adds its rank to what the one before has left; one may fail half-way."""
    for k in range(rounds):
        if rank == k % size:
            out[0] = 3 * out[0] % 1001 + rank
        if rank == fails and 2 * k > rounds:
            raise MemoryError
        meet(barrier, size)


@pytest.fixture(autouse=True)
def _two_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


def result(fails: int = -1) -> int:
    out = np.zeros(1, np.int64)
    team.run(turns, 20_000, fails, out)
    return int(out[0])


def test_each_meeting_waits_for_all() -> None:
    expected = 0
    for k in range(20_000):
        expected = 3 * expected % 1001 + k % 2
    assert result() == expected


@pytest.mark.parametrize("rank", [0, 1])
@pytest.mark.timeout(60)
def test_a_thread_that_fails_leaves_none_waiting(rank: int) -> None:
    with pytest.raises(MemoryError):
        result(fails=rank)
    assert result() == result()


@numba.njit(nogil=True)
def mark(counter, pieces):  # type: ignore[no-untyped-def]
    k = take(counter)
    while k < len(pieces):
        pieces[k] += 1
        k = take(counter)


@pytest.mark.parametrize("samples", [1, 10**6])
def test_each_piece_that_is_handed_out_is_taken_once(samples: int) -> None:
    pieces = np.zeros(1000, np.int64)
    team.hand_out(samples, mark, pieces)
    assert (pieces == 1).all()
