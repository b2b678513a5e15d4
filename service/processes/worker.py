"""A process that does what it is asked, one thing after the other."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from threading import Lock
from typing import Any, Self

from service.errors import HungError, WorkerError
from service.processes.channel import Channel

_NICENESS = 5
"""The capture goes first: a late map is late, a late frame is lost."""

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

_START = (
    "import sys; sys.path[:] = {path!r}; "
    "from service.processes.worker import serve; serve({fd}, {work!r}, {nice})"
)


@dataclass(frozen=True, slots=True)
class Interim:
    """Something that is said before the answer."""

    value: Any


class Worker:
    """A process in which one function answers whatever it is sent.

    Args:
        name: how it is called in messages.
        work: `module:function`; called once with nothing, it returns what answers each request.
        niceness: added to the priority's number.
        threads: that libraries of linear algebra may use; None = as many as they like.
        cancelled: once true, whatever is waited for is given up.
    """

    def __init__(
        self,
        name: str,
        work: str,
        *,
        niceness: int = _NICENESS,
        threads: int | None = None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        self._name, self._work, self._niceness, self.cancelled = name, work, niceness, cancelled
        self._environment = dict(os.environ)
        if threads is not None:
            self._environment |= dict.fromkeys(_THREADS, str(threads))
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: Channel | None = None
        self._asked = False
        self._killing = Lock()

    @property
    def pid(self) -> int | None:
        """Its process id; None where there is none."""
        return None if self._process is None else self._process.pid

    @property
    def is_fresh(self) -> bool:
        """Whether it was started and nothing was asked of it yet."""
        return self._process is not None and not self._asked

    def start(self) -> None:
        """Start a new process in place of the former one."""
        self.kill()
        self._asked = False
        ours, theirs = Channel.pair()
        code = _START.format(path=sys.path, fd=theirs.fileno(), work=self._work, nice=self._niceness)
        # A group of its own: signals to a process group (Ctrl-C, `timeout`) are the parent's alone to answer.
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            env=self._environment,
            process_group=0,
        )
        theirs.close()
        with self._killing:
            self._process, self._channel = process, ours

    def ask(
        self,
        request: object,
        timeout: float,
        interim: Callable[[Any], None] = lambda _: None,
        *,
        renewed: bool = True,
    ) -> Any:
        """What it answers to a request.

        Args:
            request: what is asked for.
            timeout: seconds that it may take.
            interim: called with what it says on the way, by `tell`.
            renewed: whether each such word gives it as long again.

        Raises:
            HungError: it gave no answer within `timeout` seconds.
            WorkerError: it died, or is closed.
        """
        channel = self._channel
        if channel is None:
            raise WorkerError(f"the {self._name} is closed")
        self._asked = True
        try:
            channel.send(request)
            end = time.monotonic() + timeout
            while isinstance(said := channel.receive(end - time.monotonic(), self.cancelled), Interim):
                interim(said.value)
                end = time.monotonic() + timeout if renewed else end
            return said
        except TimeoutError as error:
            raise HungError(f"the {self._name} gave no answer within {timeout:g} s") from error
        except (EOFError, WorkerError) as error:
            raise WorkerError(f"the {self._name} died ({self._ending()})") from error

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        """End the process at once; safe where there is none."""
        with self._killing:
            process, self._process = self._process, None
            channel, self._channel = self._channel, None
        if process is not None:
            process.kill()
            with suppress(subprocess.TimeoutExpired):
                process.wait(1.0)  # on a busy machine even that takes a while
        if channel is not None:
            channel.close()

    def _ending(self) -> str:
        process = self._process
        if process is None:
            return "closed"
        try:
            code = process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "it closed its connection"
        return f"signal {-code}" if code < 0 else f"exit status {code}"


def tell(value: object) -> None:
    """Inside the process: say something before the answer; nothing happens elsewhere."""
    for channel in _serving:
        channel.send(Interim(value))


_serving: list[Channel] = []
"""Inside the process: its connection."""


def serve(descriptor: int, work: str, niceness: int) -> None:
    """What runs inside the process: answers until the connection ends."""
    import socket

    os.nice(niceness)
    channel = Channel(socket.socket(fileno=descriptor))
    _serving.append(channel)
    module, _, name = work.partition(":")
    answer = getattr(import_module(module), name)()
    with suppress(EOFError, WorkerError):
        while True:
            channel.send(answer(channel.receive()), timeout=600.0)
