"""What a worker of a cluster does for a service: a burst in, a map out."""

import pickle
from threading import Lock

from service.errors import ClusterError
from service.fusion.answering import warm_up
from service.fusion.fuse import fuse_burst
from service.fusion.job import BurstJob, Failure, WarmUp
from service.messages.map import FusedMap
from service.processes.guest import as_guest
from service.versions import software_version
from solver.errors import FusionError

_one = Lock()
"""One solve at a time in a process, however many threads the worker has: the kernels' threads are shared."""


def packed(request: BurstJob | WarmUp) -> bytes:
    """A request as it travels: whole, and only read where the version is known to be the same."""
    return pickle.dumps(request, protocol=5)


def answer_there(version: str, request: bytes) -> FusedMap | Failure | None:
    """Fuse a burst with one thread of the solver, or have the kernels ready.

    Args:
        version: of whoever asks; another one's requests are not even read.
        request: as `packed`.

    Raises:
        ClusterError: this worker has another version.
    """
    if version != software_version():
        raise ClusterError(f"a worker has lidarboost {software_version()}, this is {version}")
    asked: BurstJob | WarmUp = pickle.loads(request)
    with _one:
        return as_guest(lambda: _answer(asked))


def _answer(asked: BurstJob | WarmUp) -> FusedMap | Failure | None:
    try:
        if isinstance(asked, WarmUp):
            warm_up(asked)
            return None
        return fuse_burst(asked.burst, asked.settings)
    except FusionError as error:
        return Failure(str(error))
