"""The process that fuses, seen from the daemon: started, fed, waited for, killed."""

import time
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from service.config.sections import FusionSection
from service.errors import WorkerError
from service.fusion.fuse import FusedBurst
from service.fusion.serving import Failure, Ready, serve
from service.messages.burst import Burst

_START_TIMEOUT = 600.0
"""Seconds to import and compile the kernels: a few; two minutes where nothing is cached yet."""


class FusionProcess:
    """A process and the pipe to it.

    Args:
        settings: how to fuse.
        cancelled: once true, whatever is waited for is given up.
    """

    def __init__(self, settings: FusionSection, cancelled: Callable[[], bool]) -> None:
        self._settings, self._cancelled = settings, cancelled
        self._context = get_context("spawn")  # fork would copy locks held by the session's threads
        self._process: Any = None
        self._pipe: Connection | None = None
        self._killing = Lock()

    def start(self) -> Ready | Failure:
        """Start a new process and wait until it is ready; raises WorkerError where it dies before."""
        self.kill()
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=serve, args=(theirs, self._settings), name="lidarboost-fusion", daemon=True
        )
        process.start()
        theirs.close()
        with self._killing:
            self._process, self._pipe = process, ours
        answer = self._receive(_START_TIMEOUT)
        assert isinstance(answer, (Ready, Failure))
        return answer

    def fuse(self, burst: Burst) -> FusedBurst | Failure:
        """One burst through the process; raises WorkerError where it died or took too long."""
        try:
            self._connection().send(burst)
        except OSError as error:
            raise WorkerError(f"the fusion worker died ({self._ending()})") from error
        answer = self._receive(self._settings.timeout)
        assert isinstance(answer, (FusedBurst, Failure))
        return answer

    def kill(self) -> None:
        """End the process at once; safe where there is none."""
        with self._killing:
            process, self._process = self._process, None
            pipe, self._pipe = self._pipe, None
        if process is not None:
            process.kill()
            process.join(5.0)
        if pipe is not None:
            pipe.close()

    def _connection(self) -> Connection:
        if self._pipe is None:
            raise WorkerError("the fusion worker is closed")
        return self._pipe

    def _receive(self, timeout: float) -> object:
        pipe = self._connection()
        end = time.monotonic() + timeout
        try:
            # The pipe reports its end when the process dies, whatever it dies of.
            while time.monotonic() < end and not self._cancelled():
                if pipe.poll(min(0.5, max(0.0, end - time.monotonic()))):
                    answer: object = pipe.recv()
                    return answer
        except (EOFError, OSError) as error:
            raise WorkerError(f"the fusion worker died ({self._ending()})") from error
        raise WorkerError(f"the fusion worker gave no answer within {timeout:g} s")

    def _ending(self) -> str:
        process = self._process
        if process is None:
            return "closed"
        process.join(1.0)
        code = process.exitcode
        return f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
