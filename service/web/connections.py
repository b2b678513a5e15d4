"""Connections that nobody is behind any more, or never was: ended in time, whatever they hold up."""

import asyncio
import socket
from typing import Any, cast

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

_REQUEST = 10.0
"""Seconds in which a new connection sends a request, whole."""

_UNACKNOWLEDGED = 30_000
"""Milliseconds after which a peer that acknowledges nothing is gone (TCP_USER_TIMEOUT, tcp(7))."""


class HttpConnection(H11Protocol):
    """HTTP, with a deadline for the first request; later ones have the server's keep-alive limit."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        peer = transport.get_extra_info("socket")
        if peer is not None and hasattr(socket, "TCP_USER_TIMEOUT"):
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED)
        self.loop.call_later(_REQUEST, self._expect_request)

    def _expect_request(self) -> None:
        is_upgraded = self.transport.get_protocol() is not self
        if cast(Any, self.cycle) is None and not is_upgraded:
            self.transport.abort()


class PageConnection(WebSocketsSansIOProtocol):
    """A WebSocket; one whose browser answers no ping is cut off, also with much on its way to it."""

    def keepalive_timeout(self) -> None:
        super().keepalive_timeout()
        self.transport.abort()
