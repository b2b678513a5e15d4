"""How long a job, or the start of a process, may take, from how long such took."""

from collections import defaultdict, deque

from service.fusion.job import BurstJob, Job

_REMEMBERED = 40
"""Durations: in a stream one map in thirty takes some times as long as the others."""

_FEWEST = 3
_TIMES = 10.0
_FLOOR = 4.0
"""After three jobs of a kind the next may take ten times the longest of the last ones, four seconds at least:
a machine that is busy with something else makes a job some times as long."""


_FIRST_START, _LEAST_START = 600.0, 30.0
"""Seconds until a process is ready, or says how far it is: one that compiles kernels may say nothing for
minutes; once one was ready, the next may take ten times as long as the last, half a minute at least."""


class Deadline:
    """Adapts to what is usual; never beyond what the job's settings allow.

    Args:
        floor: seconds that a job may take in any case.
    """

    def __init__(self, floor: float = _FLOOR) -> None:
        self._floor = floor
        self._start: float | None = None
        self._seen: defaultdict[tuple[object, ...], deque[float]] = defaultdict(
            lambda: deque(maxlen=_REMEMBERED)
        )

    def of(self, job: Job) -> float:
        """Seconds that a job may take."""
        seen = self._seen[_kind(job)]
        if len(seen) < _FEWEST:
            return job.settings.timeout
        return min(job.settings.timeout, max(self._floor, _TIMES * max(seen)))

    def again(self, job: Job) -> float:
        """Seconds that it may take in a new process."""
        return min(job.settings.timeout, max(_LEAST_START, 2 * self.of(job)))

    def learn(self, job: Job, seconds: float) -> None:
        """A job took so long."""
        self._seen[_kind(job)].append(seconds)

    def of_start(self) -> float:
        """Seconds that a process may take to be ready, or from one word on how far it is to the next."""
        if self._start is None:
            return _FIRST_START
        return min(_FIRST_START, max(_LEAST_START, _TIMES * self._start))

    def learn_start(self, seconds: float) -> None:
        """A process was ready after so long."""
        self._start = seconds


def _kind(job: Job) -> tuple[object, ...]:
    frames = len(job.burst.frames) if isinstance(job, BurstJob) else job.window
    return type(job), job.settings, frames
