"""Commands from the side of whoever gives them."""

import getpass
import json
import socket
import time
from dataclasses import replace
from typing import Any

import numpy as np
import zenoh

from service.errors import COMMAND_ERRORS, CommandError, RemoteError
from service.messages.decoding import Received, decode
from service.messages.topics import FUSED_CALIBRATION
from service.wire.addresses import SCHEMA

_RETRY = 0.05

_NOBODY = 1.0
"""Seconds without an answer after which it is looked whether the service has such a command at all."""


class Answer(dict[str, Any]):
    """A reply by its fields; `messages` are what came after it, by topic (bytes of a file by its name)."""

    def __init__(self, fields: dict[str, Any], messages: dict[str, Received]) -> None:
        super().__init__(fields)
        self.messages = messages


class Asking:
    """Sends commands to a service.

    Args:
        session: open.
        prefix: of the service's keys.
        endpoint: where it listens, for what is said.
    """

    def __init__(self, session: zenoh.Session, prefix: str, endpoint: str) -> None:
        self._session, self._prefix, self._endpoint = session, prefix, endpoint
        self.who = f"{_user()}@{socket.gethostname()}"

    def ask(self, name: str, timeout: float, request: dict[str, Any]) -> Answer:
        """Have a command carried out, and wait until it is.

        Raises:
            CommandError: it was refused; of a class of its own for each code.
            RemoteError: no service, no such command, or no answer within `timeout` seconds: it may be carried
                out yet.
        """
        deadline = time.monotonic() + timeout
        asked = False
        while (left := deadline - time.monotonic()) > 0:
            replies = self._query(name, request, left)
            if replies and not _ran_out(replies[0]):
                return self._read(name, replies)
            if replies:
                raise RemoteError(
                    f"{name}: not done within {timeout:g} s; it may be carried out yet: give it longer"
                )
            if not asked and timeout - left > _NOBODY:
                asked = True
                self._require_known(name, min(_NOBODY, left))
            time.sleep(min(_RETRY, max(0.0, deadline - time.monotonic())))  # nobody is there yet
        raise RemoteError(
            f"{name}: no service answered at {self._endpoint} within {timeout:g} s; does one run, is its "
            f"prefix {self._prefix!r}, and does it need longer?"
        )

    def _require_known(self, name: str, timeout: float) -> None:
        """Raise where a service is there and has no such command."""
        kind = f"{self._prefix}/{SCHEMA}/"
        replies = self._session.get(f"{kind}cmd/**", timeout=timeout)
        known = sorted(str(reply.ok.key_expr).removeprefix(kind) for reply in replies if reply.ok is not None)
        if known and name not in known:
            raise RemoteError(f"{name}: the service has no such command; it has {', '.join(known)}")

    def _query(self, name: str, request: dict[str, Any], timeout: float) -> list[zenoh.Reply]:
        replies = self._session.get(
            f"{self._prefix}/{name}",
            payload=json.dumps(request),
            encoding=zenoh.Encoding.APPLICATION_JSON,
            attachment=self.who,
            timeout=timeout,
            consolidation=zenoh.ConsolidationMode.NONE,  # all replies have the command's key
        )
        return list(replies)

    def _read(self, name: str, replies: list[zenoh.Reply]) -> Answer:
        first, *others = replies
        if first.ok is None:
            assert first.err is not None
            raise _refusal(name, first.err.payload.to_bytes())
        messages = [_message(reply.ok) for reply in others if reply.ok is not None]
        return Answer(json.loads(first.ok.payload.to_bytes()), _with_intrinsics(messages))


def _ran_out(reply: zenoh.Reply) -> bool:
    """Whether that is no answer, but Zenoh's word that none came in time."""
    return reply.err is not None and reply.err.payload.to_bytes() == b"Timeout"


def _refusal(name: str, payload: bytes) -> Exception:
    try:
        told = json.loads(payload)
        kind, message = COMMAND_ERRORS.get(told["code"], CommandError), str(told["message"])
    except (ValueError, KeyError, TypeError):  # Zenoh's own
        return RemoteError(f"{name}: {payload.decode(errors='replace') or 'no answer'}")
    return kind(message)


def _message(sample: zenoh.Sample) -> Received:
    topic = sample.attachment.to_string() if sample.attachment is not None else ""
    if str(sample.encoding) == str(zenoh.Encoding.APPLICATION_OCTET_STREAM):
        return Received(topic, sample.payload.to_bytes(), None)
    return decode(topic, str(sample.encoding), sample.payload.to_bytes())


def _with_intrinsics(messages: list[Received]) -> dict[str, Received]:
    """By topic; images with the intrinsics that came along."""
    found = {message.topic: message for message in messages}
    told = found.get(FUSED_CALIBRATION)
    if told is not None:
        matrix, lens = np.array(told.value.K).reshape(3, 3), np.array(told.value.D)
        for topic, message in found.items():
            if isinstance(message.value, np.ndarray) and message.value.ndim == 2:
                found[topic] = replace(message, intrinsics=matrix, distortion=lens)
    return found


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in some containers
        return "somebody"
