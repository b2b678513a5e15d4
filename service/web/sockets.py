"""The open pages: so many at most, and whoever is quiet longest makes room."""

from starlette.websockets import WebSocket

from service.web.commands import Commands
from service.web.hub import Hub
from service.web.page_socket import DISPLACED, PageSocket

MOST = 32
"""Pages that are open at once."""


class Sockets:
    """Serves WebSockets.

    Args:
        hub: what is known.
        commands: to the rig.
    """

    def __init__(self, hub: Hub, commands: Commands) -> None:
        self._hub, self._commands = hub, commands
        self._open: set[PageSocket] = set()

    async def serve(self, socket: WebSocket) -> None:
        """Serve one that is accepted, until it is closed."""
        while len(self._open) >= MOST:
            quietest = min(self._open, key=lambda page: page.heard)
            self._open.discard(quietest)
            quietest.close(DISPLACED)
        page = PageSocket(socket, self._hub, self._commands)
        self._open.add(page)
        try:
            await page.serve()
        finally:
            self._open.discard(page)
