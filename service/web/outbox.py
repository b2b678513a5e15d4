"""What waits for one browser: bounded, and the newest wins wherever it may."""

import asyncio
import json
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from service.web.encoded import Encoded

_MOST_TEXTS = 2000
"""Small messages that wait: half an hour of samples. A browser farther behind begins anew."""


class TooSlowError(Exception):
    """Not even the small messages go out."""


class Outbox:
    """Collects for one socket, and sends as fast as that takes it; for the event loop's thread.

    Images go out one by one for each topic: the next, which is the newest then, once the browser has said
    that the last one is drawn. Whatever sleeps, or is slow, so holds up nothing but itself.

    Args:
        send_text, send_bytes: to the socket; each returns when the socket has taken it.
        remote: whether images shall be compressed.
    """

    def __init__(
        self,
        send_text: Callable[[str], Awaitable[None]],
        send_bytes: Callable[[bytes], Awaitable[None]],
        *,
        remote: bool,
    ) -> None:
        self._send_text, self._send_bytes, self._remote = send_text, send_bytes, remote
        self._texts: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._images: dict[str, Encoded] = {}
        self._drawing: set[str] = set()
        self.shown: frozenset[str] = frozenset()
        self._is_overfull = False
        self._changed = asyncio.Event()

    def put(self, message: dict[str, Any]) -> None:
        """A message that must arrive, in its order."""
        self.put_text(json.dumps(message))

    def put_text(self, text: str) -> None:
        """As `put`, encoded already."""
        if len(self._texts) >= _MOST_TEXTS:
            self._texts.clear()
            self._is_overfull = True
        self._texts.append(text)
        self._changed.set()

    def put_newest(self, key: str, text: str) -> None:
        """A message that takes the place of one with this key, if that still waits."""
        self._newest[key] = text
        self._changed.set()

    def put_image(self, topic: str, image: Encoded) -> None:
        """An image, where it is shown."""
        if topic in self.shown:
            self._images[topic] = image
            self._changed.set()

    def show(self, topics: Iterable[str]) -> frozenset[str]:
        """From now on these images and no others; which of them are new."""
        before, self.shown = self.shown, frozenset(topics)
        new = self.shown - before
        self._drawing &= before & self.shown
        self._images = {topic: image for topic, image in self._images.items() if topic in self.shown}
        return new

    def drawn(self, topic: str) -> None:
        """The browser has drawn the last image of a topic."""
        self._drawing.discard(topic)
        self._changed.set()

    async def pump(self) -> None:
        """Send until cancelled.

        Raises:
            TooSlowError: too much waits.
        """
        while True:
            await self._changed.wait()
            self._changed.clear()
            await self._send_small()
            while (ready := next((t for t in self._images if t not in self._drawing), None)) is not None:
                image = self._images.pop(ready)
                self._drawing.add(ready)
                await self._send_bytes(await image.frame(compressed=self._remote))
                await self._send_small()

    async def _send_small(self) -> None:
        while self._texts or self._newest:
            if self._is_overfull:
                raise TooSlowError
            text = self._texts.popleft() if self._texts else self._newest.pop(next(iter(self._newest)))
            await self._send_text(text)
