"""Metrics for Prometheus, and whether the service is alive and ready, by HTTP on loopback."""

import errno
import json
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any, ClassVar
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field

from service.errors import ConfigurationError, OutputError
from service.messages.events import Event, StatusTold
from service.messages.status import Status
from service.sinks.sink import Sink
from service.wire.sockets import holder

ADDRESS = "127.0.0.1"

_HOSTS = frozenset({"127.0.0.1", "localhost"})
"""What a request may say that it goes to: a page of elsewhere whose name was pointed here says its own."""

_SILENT = 10.0
"""Seconds without a status after which the service does not count as alive."""

_STALE = 60.0
"""Seconds without a frame, beyond the configured pause, after which a scan or a stream is not ready."""

_REQUEST = 5.0
"""Seconds that a request may take."""

Answer = tuple[HTTPStatus, str, bytes]


class Metrics(Sink):
    """Serves `/metrics`, `/healthz` (alive: the status is told), `/readyz` (frames come where they shall)."""

    wants = (StatusTold,)

    class Options(BaseModel):
        model_config = ConfigDict(extra="forbid", frozen=True)
        port: int = Field(9464, ge=0, le=65535, description="TCP port on 127.0.0.1; 0 = any that is free.")

    def __init__(self, options: BaseModel | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(options)
        self._clock = clock
        self._status: Status | None = None
        self._told = self._grew = clock()
        self.port = 0

    def open(self) -> None:
        try:
            from prometheus_client import (
                CONTENT_TYPE_LATEST,
                CollectorRegistry,
                ProcessCollector,
                generate_latest,
            )

            from service.sinks.exposition import StatusCollector
        except ImportError as error:
            raise ConfigurationError(
                "metrics need the library prometheus-client: pip install 'lidarboost[metrics]'"
            ) from error
        self._kind, registry = CONTENT_TYPE_LATEST, CollectorRegistry()
        self._collector = StatusCollector()
        registry.register(self._collector)
        ProcessCollector(registry=registry)  # memory, descriptors, processor time
        self._exposed: Callable[[], bytes] = lambda: generate_latest(registry)
        self._server = self._listening(self.options.port)  # type: ignore[attr-defined]
        self.port = self._server.server_address[1]
        Thread(target=self._server.serve_forever, args=(0.1,), name="metrics", daemon=True).start()

    def take(self, event: Event) -> None:
        assert isinstance(event, StatusTold)
        before, now = self._status, self._clock()
        if before is None or event.status.totals.frames != before.totals.frames:
            self._grew = now
        self._status = self._collector.status = event.status
        self._told = now

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def abandon(self) -> None:
        self._server.socket.close()

    def answer(self, path: str) -> Answer:
        """What a path gives: status, type and body."""
        if path == "/metrics":
            return HTTPStatus.OK, self._kind, self._exposed()
        if path == "/healthz":
            return _said(self._not_alive(), self._status)
        if path == "/readyz":
            return _said(self._not_alive() or self._not_ready(), self._status)
        return HTTPStatus.NOT_FOUND, "text/plain", b"there are /metrics, /healthz and /readyz\n"

    def _not_alive(self) -> str:
        """Why it does not count as alive; nothing where it does."""
        silent = self._clock() - self._told
        return f"no status for {silent:.0f} s" if silent > _SILENT else ""

    def _not_ready(self) -> str:
        status = self._status
        if status is None:
            return "it starts"
        if status.state not in ("idle", "scanning", "streaming"):
            return f"{status.state}: {status.reason}"
        stale = self._clock() - self._grew - status.in_force.pause
        if status.state != "idle" and not status.paused and stale > _STALE:
            return f"{status.state}, but no frame for {self._clock() - self._grew:.0f} s"
        return ""

    def _listening(self, port: int) -> ThreadingHTTPServer:
        class Handler(_Handler):
            sink = self

        try:
            return ThreadingHTTPServer((ADDRESS, port), Handler)
        except OSError as error:
            who = holder(port) or "another process"
            raise OutputError(
                f"metrics: {ADDRESS}:{port} is in use by {who}; set metrics.port to another one"
                if error.errno == errno.EADDRINUSE
                else f"metrics: cannot listen on {ADDRESS}:{port} ({error.strerror})"
            ) from error


class _Handler(BaseHTTPRequestHandler):
    sink: ClassVar[Metrics]
    timeout = _REQUEST
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "lidarboost", ""

    def do_GET(self) -> None:
        host = urlsplit(f"//{self.headers.get('Host', '')}").hostname
        if host not in _HOSTS:
            self._send((HTTPStatus.FORBIDDEN, "text/plain", b"this is for 127.0.0.1 and localhost\n"))
        else:
            self._send(self.sink.answer(self.path.partition("?")[0]))

    do_HEAD = do_GET  # noqa: N815 — as the base class has it

    def _send(self, answer: Answer) -> None:
        status, kind, body = answer
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Nothing: somebody asks every few seconds, for weeks."""


def _said(why_not: str, status: Status | None) -> Answer:
    told = {"ok": not why_not, "why": why_not, "state": "starting" if status is None else status.state}
    code = HTTPStatus.SERVICE_UNAVAILABLE if why_not else HTTPStatus.OK
    return code, "application/json", json.dumps(told, ensure_ascii=False).encode() + b"\n"
