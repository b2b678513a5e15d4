"""From a request to its answer: read, carried out where it belongs, answered, noted."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from concurrent.futures import Future
from threading import BoundedSemaphore, Lock, Thread
from typing import Any

from drivers.errors import DriverError, InitialisationError, LimitError, MotionStoppedError, StateError
from service.daemon.desk import Desk
from service.daemon.verb import Answer, Command, Outcome, Reply, Verb
from service.errors import (
    CommandError,
    ConfigurationError,
    InternalError,
    InvalidArgumentError,
    InvalidStateError,
    IoFailureError,
    MotionError,
    NotFoundError,
    OutOfRangeError,
    OutputError,
    PermissionDeniedError,
    PlanError,
    UnavailableError,
)
from service.messages.events import Commanded
from service.messages.status import CommandCounts
from service.wire.queries import Request

_ASIDE = 4
"""Verbs that may wait for a disk at the same time."""

_CODES: tuple[tuple[type[Exception], type[CommandError]], ...] = (
    (PlanError, OutOfRangeError),
    (LimitError, OutOfRangeError),
    (InitialisationError, OutOfRangeError),
    (ConfigurationError, InvalidArgumentError),
    (StateError, InvalidStateError),
    (MotionStoppedError, InvalidStateError),
    (MotionError, IoFailureError),
    (DriverError, IoFailureError),
    (OutputError, IoFailureError),
    (FileNotFoundError, NotFoundError),
    (PermissionError, PermissionDeniedError),
    (OSError, IoFailureError),
)
"""What is answered where something else than a refusal is raised; the first that fits."""

_log = logging.getLogger(__name__)


class Dispatcher:
    """Has commands carried out.

    Args:
        desk: what verbs work with.
        table: the commands by name.
    """

    def __init__(self, desk: Desk, table: Mapping[str, Command]) -> None:
        self._desk, self._table = desk, table
        self._aside = BoundedSemaphore(_ASIDE)
        self._lock = Lock()
        self._accepted = 0
        self._refused: dict[str, int] = {}

    @property
    def counts(self) -> CommandCounts:
        """How many were carried out, and refused."""
        with self._lock:
            return CommandCounts(accepted=self._accepted, refused=dict(self._refused))

    def refused(self, code: str) -> None:
        """Count a refusal."""
        with self._lock:
            self._refused[code] = self._refused.get(code, 0) + 1

    def handle(self, request: Request) -> None:
        """Begin with a request; it is answered now or later."""
        try:
            verb = self._table[request.name].read(request.payload)
            self._place(request, verb)
        except Exception as error:
            self._refuse(request, error)

    def _place(self, request: Request, verb: Verb) -> None:
        desk = self._desk
        if verb.place == "here":
            self._finish(request, verb, verb.carry_out(desk))
        elif verb.place == "aside":
            self._begin_aside(request, verb)
        else:
            desk.admit(verb.place)
            errand = desk.daemon.control.inbox.submit(lambda: verb.carry_out(desk), verb.place)
            errand.add_done_callback(lambda done: self._finish(request, verb, done))

    def _begin_aside(self, request: Request, verb: Verb) -> None:
        if not self._aside.acquire(blocking=False):
            raise UnavailableError(f"{_ASIDE} such commands are at work already: try again later")

        def work() -> None:
            try:
                answer = verb.carry_out(self._desk)
            except Exception as error:
                self._refuse(request, error)
            else:
                self._finish(request, verb, answer)
            finally:
                self._aside.release()

        Thread(target=work, name=request.name, daemon=True).start()

    def _finish(self, request: Request, verb: Verb, answer: Answer | Future[Answer]) -> None:
        if isinstance(answer, Future) and not answer.done():
            answer.add_done_callback(lambda done: self._finish(request, verb, done))
            return
        if isinstance(answer, Future):
            error = answer.exception()
            if error is not None:
                self._refuse(request, error)
            else:
                self._finish(request, verb, answer.result())
            return
        with self._lock:
            self._accepted += 1
        self._note(request, verb)
        outcome = Outcome(answer) if isinstance(answer, Reply) else answer
        request.answer(outcome.reply.payload(), outcome.messages)

    def _note(self, request: Request, verb: Verb) -> None:
        if not verb.changes:
            return
        what: dict[str, Any] = verb.model_dump(mode="json", exclude_unset=True)
        _log.info("%s %s by %s", request.name, what, request.who)
        daemon = self._desk.daemon
        daemon.emit(Commanded(request.who, daemon.rig.clock.now(), request.name, what))

    def _refuse(self, request: Request, error: BaseException) -> None:
        refusal = refusal_of(error)
        self.refused(refusal.code)
        if isinstance(refusal, InternalError):
            _log.error("%s failed: %s", request.name, refusal, exc_info=error)
        request.refuse(refusal)


def refusal_of(error: BaseException) -> CommandError:
    """What is answered where this was raised."""
    if isinstance(error, CommandError):
        return error
    text = " ".join(str(error).split()) or type(error).__name__
    return next((code(text) for kind, code in _CODES if isinstance(error, kind)), InternalError(text))
