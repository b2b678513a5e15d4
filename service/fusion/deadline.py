"""How long a job may take, from how long such jobs took."""

from collections import defaultdict, deque

from service.fusion.job import BurstJob, Job

_REMEMBERED = 40
"""Durations: in a stream one map in thirty takes some times as long as the others."""

_FEWEST = 3
_TIMES = 10.0
_FLOOR = 4.0
"""After three jobs of a kind the next may take ten times the longest of the last ones, four seconds at least:
a machine that is busy with something else makes a job some times as long."""


class Deadline:
    """Adapts to what is usual; never beyond what the job's settings allow.

    Args:
        floor: seconds that a job may take in any case.
    """

    def __init__(self, floor: float = _FLOOR) -> None:
        self._floor = floor
        self._seen: defaultdict[tuple[object, ...], deque[float]] = defaultdict(
            lambda: deque(maxlen=_REMEMBERED)
        )

    def of(self, job: Job) -> float:
        """Seconds that a job may take."""
        seen = self._seen[_kind(job)]
        if len(seen) < _FEWEST:
            return job.settings.timeout
        return min(job.settings.timeout, max(self._floor, _TIMES * max(seen)))

    def learn(self, job: Job, seconds: float) -> None:
        """A job took so long."""
        self._seen[_kind(job)].append(seconds)


def _kind(job: Job) -> tuple[object, ...]:
    frames = len(job.burst.frames) if isinstance(job, BurstJob) else job.window
    return type(job), job.settings, frames
