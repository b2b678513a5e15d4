"""The server of the live page, in a thread of its own."""

import asyncio
import socket
from concurrent.futures import Future
from threading import Thread
from types import TracebackType
from typing import Self

import uvicorn

from service.errors import OutputError, ServiceError
from service.web.access import Access
from service.web.app import make_app
from service.web.commands import Commands
from service.web.connections import HttpConnection, PageConnection
from service.web.downloads import Downloads
from service.web.hub import Hub
from service.web.options import PageOptions
from service.web.rig import RigWatch
from service.web.sockets import Sockets

_LARGEST_MESSAGE = 64 << 10
"""Bytes that a page may send at once."""

_PING = 10.0
"""Seconds between two pings, and until an answer to one; a browser that sleeps gives none."""

_START, _END = 20.0, 20.0
"""Seconds to begin, and to end: a session that is cut off at the process' exit would abort it."""


class PageServer:
    """Serves the page from `start` to `close`. The rig need not run.

    ```python
    with PageServer(PageOptions(port=0)) as page:
        print(page.url)
    ```

    Args:
        options: where, and of which rig.

    Raises:
        ServiceError: the address cannot be listened on, or the rig's is none.
    """

    def __init__(self, options: PageOptions) -> None:
        self._options = options
        self._listening = _listen(options)
        self._started: Future[None] = Future()
        self._server: uvicorn.Server | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = Thread(target=self._run, name="live page", daemon=True)

    @property
    def url(self) -> str:
        """Where to open it, without the token."""
        host, port = self._listening.getsockname()[:2]
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"

    def start(self) -> Self:
        """Begin to serve; returns when it is ready."""
        self._thread.start()
        try:
            self._started.result(_START)
        except BaseException:
            self.close()
            raise
        return self

    def check(self, timeout: float = 5.0) -> None:
        """Raise `ServiceError` unless it works: its loop turns, and serves."""
        loop, server = self._loop, self._server
        if loop is None or server is None or not self._thread.is_alive():
            raise ServiceError("the live page has ended")
        turned: Future[None] = Future()
        loop.call_soon_threadsafe(turned.set_result, None)
        try:
            turned.result(timeout)
        except TimeoutError as error:
            raise ServiceError("the live page hangs") from error

    def stop(self) -> None:
        """Have it end soon; for any thread, and for a signal's handler."""
        if self._server is not None:
            self._server.should_exit = True

    def close(self) -> None:
        """End it, and every open page."""
        self.stop()
        if self._thread.ident is not None:
            self._thread.join(_END)
        self._listening.close()

    def wait(self, timeout: float | None = None) -> bool:
        """Until it has ended by itself; whether it has."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            if self._started.done():
                raise
            self._started.set_exception(error)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        hub = Hub(self._options)
        rig = RigWatch(self._options, self._loop, hub)
        try:
            rig.start()
            app = make_app(
                Access(self._options), hub, Sockets(hub, Commands(rig.client.ask)), Downloads(rig.client)
            )
            self._server = server = uvicorn.Server(_configured(app))
            serving = asyncio.create_task(server.serve(sockets=[self._listening]))
            while not server.started and not serving.done():
                await asyncio.sleep(0.01)
            self._started.set_result(None)
            await serving
        finally:
            await asyncio.to_thread(rig.close)


def _configured(app: object) -> uvicorn.Config:
    return uvicorn.Config(
        app,  # type: ignore[arg-type]
        http=HttpConnection,
        ws=PageConnection,
        ws_max_size=_LARGEST_MESSAGE,
        ws_ping_interval=_PING,
        ws_ping_timeout=_PING,
        ws_per_message_deflate=False,  # images are packed where that pays, small messages are small
        timeout_keep_alive=15,
        timeout_graceful_shutdown=1,
        lifespan="off",
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        date_header=True,
    )


def _listen(options: PageOptions) -> socket.socket:
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    try:
        return socket.create_server((options.host, options.port), family=family, backlog=128)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(
            f"the live page cannot listen on {options.host}, port {options.port} ({reason}); choose another "
            "web.host or web.port (--host, --port)"
        ) from error
