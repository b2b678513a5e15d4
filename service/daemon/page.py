"""The live page's process: started beside the daemon, watched, and started again; nobody else notices."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from service.config.sections import Configuration
from service.config.served import WebSection
from service.daemon.states import States
from service.errors import WorkerError
from service.processes.worker import Worker
from service.versions import PAGE_PACKAGES, require_packages
from service.wire.session import endpoint_of

_START, _ANSWER = 60.0, 15.0
"""Seconds that it may take to begin, and to say that it works."""

_BEAT = 2.0
_FIRST_PAUSE, _LONGEST_PAUSE = 0.5, 30.0
"""Seconds before it is started again: twice as long each time, until it has worked for a while."""

_PART = "live page"
_REMEDY = "it is started again by itself"

_log = logging.getLogger(__name__)


class PageKeeper:
    """Keeps the process of the page.

    Args:
        section: how it is served.
        endpoint, prefix: where the page finds the rig.
        states: told while it does not work.
    """

    def __init__(self, section: WebSection, endpoint: str, prefix: str, states: States) -> None:
        token = section.token
        self._options = section.model_dump() | {
            "endpoint": endpoint,
            "prefix": prefix,
            "client": os.environ.get("LIDARBOOST_CLIENT") or None,
            "token": None if token is None else token.get_secret_value(),
        }
        self._states = states
        self._over = Event()
        self._said = ""
        self._worker = Worker(_PART, "service.web.process:serving", cancelled=self._over.is_set)
        self._thread = Thread(target=self._run, name="page keeper", daemon=True)
        self.url: str | None = None
        """Where the page is; None while it is not."""

    @property
    def pid(self) -> int | None:
        """Of its process; None where there is none."""
        return self._worker.pid

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the process."""
        self._over.set()
        self._worker.kill()
        self._thread.join(5.0)
        self._worker.kill()  # one that was being started meanwhile

    def _run(self) -> None:
        pause = _FIRST_PAUSE
        while not self._over.is_set():
            try:
                self._begin()
                while not self._over.wait(_BEAT):
                    self._ask(None, _ANSWER)
                    pause = _FIRST_PAUSE
                return
            except WorkerError as error:
                if self._over.is_set():
                    return
                if str(error) != self._said:
                    _log.error("%s; %s", error, _REMEDY)
                self._said = str(error)
                self._states.degrade(_PART, str(error), _REMEDY)
                self.url = None
            self._worker.kill()
            self._over.wait(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)

    def _begin(self) -> None:
        self._worker.start()
        self.url = self._ask(self._options, _START)
        self._states.mend(_PART)
        _log.info("live page: %s", self.url)

    def _ask(self, request: object, timeout: float) -> str:
        answer = str(self._worker.ask(request, timeout))
        if answer.startswith("error: "):
            raise WorkerError(answer.removeprefix("error: "))
        return answer


@contextmanager
def kept_page(configuration: Configuration, states: States) -> Iterator[PageKeeper]:
    """The page's process of a service meanwhile.

    Raises:
        ConfigurationError: what it needs is not installed.
        SessionError: there is no way to the service for it.
    """
    require_packages("web", *PAGE_PACKAGES)
    zenoh = configuration.zenoh
    keeper = PageKeeper(configuration.web, endpoint_of(zenoh.config), zenoh.prefix, states)
    keeper.start()
    try:
        yield keeper
    finally:
        keeper.close()
