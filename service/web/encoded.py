"""An image that is encoded for browsers when the first of them takes it, and once for all."""

import asyncio

from service.web.images import Picture


class Encoded:
    """For the event loop's thread; the work is done in another.

    Args:
        picture: to be sent.
    """

    def __init__(self, picture: Picture) -> None:
        self._picture = picture
        self._frames: dict[bool, asyncio.Task[bytes]] = {}

    async def frame(self, *, compressed: bool) -> bytes:
        """The binary frame; its data compressed, where that pays."""
        if compressed not in self._frames:
            making = asyncio.to_thread(self._picture.frame, compressed=compressed)
            self._frames[compressed] = asyncio.create_task(making)
        # Whoever is cancelled meanwhile must not take the work from the others.
        return await asyncio.shield(self._frames[compressed])
