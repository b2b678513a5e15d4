"""An existing Dask cluster: reached within a time limit, and made sure that its workers are of our kind."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from queue import Empty, Queue
from threading import Thread
from typing import Any, TypeVar

from service.errors import ClusterError
from service.versions import software_version

_LIMIT = 20.0
"""Seconds for a scheduler to answer: some for a busy one, few for whoever has mistyped its address."""

T = TypeVar("T")


@contextmanager
def connected(address: str, limit: float = _LIMIT) -> Iterator[Any]:
    """A `distributed.Client` of the scheduler at an address such as `tcp://10.0.0.7:8786`.

    Raises:
        ClusterError: the library is not installed, nobody answers, there are no workers, or one of them has
            another version of this package.
    """
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
    except ImportError as error:
        raise ClusterError(
            "a cluster needs the library distributed, which is not installed: "
            "pip install 'lidarboost[cluster]'"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is said here, in one line
    try:
        get_address_host_port(address)
    except ValueError as error:
        raise ClusterError(
            f"{address!r} is no address of a scheduler ({error}); expected one such as tcp://10.0.0.7:8786"
        ) from error
    make: Any = Client  # not typed
    client = within(limit, address, lambda: make(address, timeout=limit / 2, set_as_default=False))
    try:
        if not workers_of(client, address, limit):
            raise ClusterError(
                f"{address}: the cluster has no workers; start some: dask worker {address} --nthreads 1"
            )
        _check_versions(client, address, limit)
        yield client
    finally:
        with suppress(ClusterError):
            within(limit, address, lambda: client.close(timeout=limit / 4))


def workers_of(client: Any, address: str, limit: float = _LIMIT) -> int:
    """How many workers there are; raises `ClusterError` where the scheduler does not answer."""
    said = within(limit, address, lambda: client.sync(client.scheduler.identity, n_workers=-1))
    return len(said["workers"])


def within(limit: float, address: str, call: Callable[[], T]) -> T:
    """What a call gives that the library may let wait for ever.

    Raises:
        ClusterError: it took longer, or failed.
    """
    answers: Queue[T | BaseException] = Queue()

    def work() -> None:
        try:
            answers.put(call())
        except BaseException as error:  # told to whoever waits
            answers.put(error)

    Thread(target=work, name="cluster", daemon=True).start()
    advice = "is a Dask scheduler running there (dask scheduler), and can it be reached from here?"
    try:
        answer = answers.get(timeout=limit)
    except Empty:
        raise ClusterError(f"{address}: no answer within {limit:g} s; {advice}") from None
    if isinstance(answer, BaseException):
        raise ClusterError(f"{address}: {_reason(answer)}; {advice}") from answer
    return answer


def _reason(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")


def _check_versions(client: Any, address: str, limit: float) -> None:
    """Ask by the standard library alone: what is ours may not even be there, or not be understood."""
    said: dict[str, Any] = within(
        limit, address, lambda: client.run(version, "lidarboost", on_error="return")
    )
    ours = software_version()
    for worker, answer in sorted(said.items()):
        theirs = answer if isinstance(answer, str) else "unknown"
        if theirs != ours:
            raise ClusterError(
                f"{address}: the worker {worker} has lidarboost {theirs}, this is {ours}; "
                "install the same version on every worker"
            )
