"""Who turns jobs into maps."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol

from service.fusion.job import Iterating, Job
from service.messages.map import FusedMap
from service.messages.status import FusionState


class Executor(Protocol):
    """Takes jobs at any time and works them off; may be one process here or many elsewhere.

    A job's future raises `FusionError` where the frames cannot be fused, and `WorkerError` where whoever
    fuses them failed over it more often than a restart can mend. One that has not begun can be cancelled.
    Whoever can tell how far the solver is calls `iterating` now and then.
    """

    def submit(
        self, job: Job, iterating: Callable[[Iterating], None] = lambda _: None
    ) -> "Future[FusedMap]": ...

    @property
    def state(self) -> FusionState: ...

    def close(self) -> None:
        """Give up what is left, at once."""
