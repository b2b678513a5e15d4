"""Commands as Zenoh queries: what is let in at all, and how it is answered."""

import json
import logging
from collections.abc import Callable, Iterable, Sequence
from threading import Lock, Thread
from types import TracebackType
from typing import Any, Self

import zenoh

from drivers.messages import Message
from drivers.names import shown
from service.allowance import Allowance
from service.errors import CommandError, InvalidArgumentError, UnavailableError
from service.wire.declarations import withdraw
from service.wire.encoding import Octets, encoding
from service.wire.pending import Pending

MOST_BYTES = 1_000_000
"""Size of a request."""

_PER_SECOND, _BURST = 50.0, 100.0
"""Requests that are let in: in the long run, and at once."""

_WAITING = 64
"""Requests that may wait to be looked at."""

_URGENT = (b'"stop"', b'"cancel"', b'"pause"')
_URGENT_BYTES = 200
"""What makes the rig stand still is let in however many others ask for other things."""

_WHO_BYTES = 200

_log = logging.getLogger(__name__)


class Request:
    """One command as it came: its name, its payload, and who sent it; to be answered once.

    Attributes:
        name: of the command, such as `cmd/scan`.
        payload: JSON, as it came.
        who: as the sender calls itself, or the id of its Zenoh session.
    """

    def __init__(self, query: zenoh.Query, key: str, name: str, payload: bytes) -> None:
        self._query, self._key = query, key
        self.name, self.payload, self.who = name, payload, _sender(query)
        self._lock = Lock()
        self._open = True

    def answer(self, reply: bytes, messages: Sequence[Message | Octets] = ()) -> None:
        """Send the reply, JSON, then messages as they are published, each named in its attachment."""
        with self._lock:
            if self._open:
                self._send(reply, messages)
                self._end()

    def refuse(self, error: CommandError) -> None:
        """Send why not."""
        with self._lock:
            if self._open:
                _refuse(self._query, error)
                self._end()

    def _send(self, reply: bytes, messages: Sequence[Message | Octets]) -> None:
        try:
            self._query.reply(self._key, reply, encoding=zenoh.Encoding.APPLICATION_JSON)
            for message in messages:
                self._query.reply(
                    self._key, message.payload, encoding=encoding(message), attachment=message.topic
                )
        except zenoh.ZError as error:
            _log.info("%s: whoever asked is gone (%s)", self.name, error)

    def _end(self) -> None:
        self._open = False
        _drop(self._query)


class Queries:
    """Takes in the commands of a service.

    A query is carried out only where its selector is exactly a command's key and its payload is there and no
    longer than 1 MB, and at most fifty a second are looked at.

    Args:
        session: open; it must outlive this.
        prefix: of every key.
        names: of the commands.
        handle: called with one request after the other, in one thread; must not wait for anything.
        refused: told the code of every request that was not let in.
    """

    def __init__(
        self,
        session: zenoh.Session,
        prefix: str,
        names: Iterable[str],
        handle: Callable[[Request], None],
        refused: Callable[[str], None],
    ) -> None:
        self._session, self._prefix, self._names = session, prefix, tuple(names)
        self._handle, self._refused = handle, refused
        self._pending: Pending[Request] = Pending(_WAITING)
        self._allowance = Allowance(_PER_SECOND, _BURST)
        self._thread = Thread(target=self._run, name="commands", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._declared = [self._declare(name) for name in self._names]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        withdraw(self._declared)
        for request in self._pending.close():
            request.refuse(UnavailableError("the service ends"))
        self._thread.join(1.0)

    def _declare(self, name: str) -> Any:
        key = f"{self._prefix}/{name}"
        return self._session.declare_queryable(key, lambda query: self._arrived(query, key, name))

    def _arrived(self, query: zenoh.Query, key: str, name: str) -> None:
        if query.payload is None and str(query.selector) != key:
            _drop(query)  # somebody looks at everything there is: no command
            return
        try:
            payload = self._let_in(query, key)
            if not self._pending.put(Request(query, key, name, payload)):
                raise UnavailableError(f"{_WAITING} commands wait already: try again later")
        except CommandError as error:
            self._refused(error.code)
            _refuse(query, error)
            _drop(query)

    def _let_in(self, query: zenoh.Query, key: str) -> bytes:
        """The payload of a query that may be carried out; raises why one may not."""
        payload = query.payload
        if str(query.selector) != key:
            raise InvalidArgumentError(f"the selector {_brief(str(query.selector))} is not exactly {key}")
        if payload is None:
            raise InvalidArgumentError(f'{key} needs a payload, such as {{"action": "get"}}')
        if len(payload) > MOST_BYTES:
            raise InvalidArgumentError(f"{len(payload)} bytes of payload; at most {MOST_BYTES} are taken")
        data = payload.to_bytes()
        if not self._allowance.spend() and not _is_urgent(data):
            raise UnavailableError(f"more than {_PER_SECOND:g} commands a second: ask less often")
        return data

    def _run(self) -> None:
        while (request := self._pending.get()) is not None:
            try:
                self._handle(request)
            except Exception:  # the next one may do better
                _log.exception("%s", request.name)


def refusal(error: CommandError) -> bytes:
    """`{"code": …, "message": …}`."""
    return json.dumps({"code": error.code, "message": shown(error)}, ensure_ascii=False).encode()


def _refuse(query: zenoh.Query, error: CommandError) -> None:
    try:
        query.reply_err(refusal(error), encoding=zenoh.Encoding.APPLICATION_JSON)
    except zenoh.ZError as fault:
        _log.info("whoever asked is gone (%s)", fault)


def _drop(query: zenoh.Query) -> None:
    query.drop()  # type: ignore[no-untyped-call]


def _is_urgent(payload: bytes) -> bool:
    return len(payload) <= _URGENT_BYTES and any(verb in payload for verb in _URGENT)


def _sender(query: zenoh.Query) -> str:
    """What it calls itself in its attachment, else the id of its session, as far as that is known."""
    told = query.attachment
    if told is not None and len(told) <= _WHO_BYTES:
        name = told.to_bytes().decode(errors="replace")
        if name.strip() and name.isprintable():
            return name.strip()
    source = query.source_info
    return "somebody" if source is None else f"Zenoh session {source.source_id.zid}"


def _brief(text: str) -> str:
    return text if len(text) <= 120 else f"{text[:120]}…"
