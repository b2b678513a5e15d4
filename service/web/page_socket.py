"""The WebSocket of one open page."""

import asyncio
import time
from contextlib import suppress

from starlette.websockets import WebSocket, WebSocketDisconnect

from service.allowance import Allowance
from service.errors import InvalidArgumentError
from service.web.commands import Commands, error_message
from service.web.hub import Hub
from service.web.images import SOURCES
from service.web.outbox import Outbox, TooSlowError
from service.web.requests import Ack, Command, Request, Show, read_request

UNKNOWN, DISPLACED, BROKEN, TOO_SLOW = 4401, 4408, 1008, 1013
"""Close codes: the token, another page in its place, rules of the protocol, too far behind."""

_A_SECOND, _AT_ONCE = 50.0, 200.0
"""Messages that a page may send."""

_LOOPBACK = ("127.", "::1")


class PageSocket:
    """Serves one page until it is closed.

    Args:
        socket: accepted.
        hub: what is known.
        commands: to the rig.
    """

    def __init__(self, socket: WebSocket, hub: Hub, commands: Commands) -> None:
        self._socket, self._hub, self._commands = socket, hub, commands
        address = socket.client.host if socket.client is not None else ""
        self._outbox = Outbox(socket.send_text, socket.send_bytes, remote=not address.startswith(_LOOPBACK))
        self._count = commands.page()
        self._allowance = Allowance(_A_SECOND, _AT_ONCE)
        self._answering: set[asyncio.Task[None]] = set()
        self._closing: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self.heard = time.monotonic()
        """When it said something."""

    def close(self, code: int) -> None:
        """End it, soon."""
        if not self._closing.done():
            self._closing.set_result(code)

    async def serve(self) -> None:
        """Serve it; returns when it is closed, whoever closed it."""
        self._hub.join(self._outbox)
        pump, listen = asyncio.create_task(self._outbox.pump()), asyncio.create_task(self._listen())
        try:
            await asyncio.wait((pump, listen, self._closing), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._hub.leave(self._outbox)
            pump.cancel()
            listen.cancel()
            # Commands under way go on: their threads count until they end.
            ended = await asyncio.gather(pump, listen, return_exceptions=True)
        if any(isinstance(error, TooSlowError) for error in ended):
            self.close(TOO_SLOW)
        if self._closing.done():
            with suppress(RuntimeError, WebSocketDisconnect):  # it is gone
                await self._socket.close(self._closing.result())

    async def _listen(self) -> None:
        with suppress(WebSocketDisconnect):
            while True:
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                self.heard = time.monotonic()
                text = message.get("text")
                if text is None or not self._allowance.spend():
                    self.close(BROKEN)
                    return
                try:
                    self._take(read_request(text))
                except InvalidArgumentError as error:
                    self._outbox.put(error_message(None, error.code, str(error)))

    def _take(self, request: Request) -> None:
        match request:
            case Show(images=images):
                unknown = set(images) - SOURCES.keys()
                if unknown:
                    known = ", ".join(SOURCES)
                    raise InvalidArgumentError(f"no image is called {min(unknown)!r}; there are: {known}")
                self._hub.show(self._outbox, frozenset(images))
            case Ack(topic=topic):
                self._outbox.drawn(topic)
            case Command():
                task = asyncio.create_task(self._answer(request))
                self._answering.add(task)
                task.add_done_callback(self._answering.discard)

    async def _answer(self, command: Command) -> None:
        self._outbox.put(await self._commands.answer(command, self._count))
