"""The times of a recording that is played again and again."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median_low

from drivers.bursts import LONGEST_PAUSE

_SECOND = 1_000_000_000


def is_jump(step: int) -> bool:
    """Whether a clock was set, or another scan begins, between two frames `step` ns apart."""
    return not 0 <= step <= LONGEST_PAUSE


def risen(times: Sequence[int]) -> Iterator[int]:
    """The times of all rounds after the first: rising from the last one, as far apart as they were.

    A jump counts as a usual step: decades a round would soon pass the end of 64 bits.

    Args:
        times: of the frames of a round, ns.
    """
    steps = [later - earlier for earlier, later in pairwise(times)]
    usual = median_low([step for step in steps if step > 0 and not is_jump(step)] or [_SECOND])
    at = times[-1]
    while True:
        for step in (usual, *steps):
            at += usual if is_jump(step) else step
            yield at
