"""Who turns jobs into maps."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, Self

from service.fusion.job import Iterating, Job
from service.messages.map import FusedMap
from service.messages.status import FusionState


class Executor(Protocol):
    """Takes jobs at any time and works them off; may be one process here or many elsewhere.

    A job's future raises `FusionError` where the frames cannot be fused, and `WorkerError` where whoever
    fuses them failed over it more often than a restart can mend. One that has not begun can be cancelled;
    what is at work when it closes is so too.
    Whoever can tell how far the solver is calls `iterating` now and then.
    """

    def submit(
        self, job: Job, iterating: Callable[[Iterating], None] = lambda _: None
    ) -> "Future[FusedMap]": ...

    @property
    def state(self) -> FusionState: ...

    @property
    def progress(self) -> str:
        """What it does until it is ready, in words."""

    @property
    def ready(self) -> "Future[float]":
        """Seconds that it took until jobs could be done; raises `WorkerError` where it was given up."""

    def close(self) -> None:
        """Give up what is left, at once."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
