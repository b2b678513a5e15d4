"""Recordings as downloads, part by part as the rig hands them out."""

import asyncio
from collections.abc import AsyncIterator
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from service.errors import CommandError, RemoteError
from service.web.refusals import refusal
from service.web.threads import in_thread
from service.wire.asking import Answer
from service.wire.client import Client

_AT_ONCE = 4
_PART, _TIMEOUT = 1_000_000, 30.0
"""Bytes that are fetched at a time, and seconds that they may take."""
_TAKEN = 60.0
"""Seconds in which a browser takes a part; one that does not has gone to sleep."""

_STATUSES = {"NOT_FOUND": 404, "PERMISSION_DENIED": 403, "INVALID_ARGUMENT": 400, "INVALID_STATE": 409}


class Downloads:
    """Hands recordings on.

    Args:
        client: of the rig.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._under_way = 0

    async def answer(self, request: Request) -> Response:
        """The file that a request names, or why it cannot be had."""
        file = request.path_params["file"]
        if self._under_way >= _AT_ONCE:
            return refusal(503, "BUSY", f"{_AT_ONCE} downloads are under way: wait for one of them")
        try:
            first = await self._part(file, 0)
        except CommandError as error:
            return refusal(_STATUSES.get(error.code, 502), error.code, str(error))
        except RemoteError as error:
            return refusal(503, "UNREACHABLE", str(error))
        headers = {
            "content-length": str(first["part"]["total"]),
            "content-disposition": f"attachment; filename*=UTF-8''{quote(file.rpartition('/')[2], safe='')}",
            "cache-control": "no-store",
        }
        if request.method == "HEAD":
            return Response(headers=headers, media_type=_KIND)
        return _Patient(self._content(file, first), headers=headers, media_type=_KIND)

    async def _content(self, file: str, first: Answer) -> AsyncIterator[bytes]:
        """All parts; raises, which breaks the connection, where the file becomes another meanwhile."""
        self._under_way += 1
        try:
            answer, total, sent = first, first["part"]["total"], 0
            while True:
                content: bytes = answer.messages[file].value
                yield content
                sent += len(content)
                if sent >= total or not content:
                    return
                answer = await self._part(file, sent)
                if answer["part"]["total"] != total:
                    raise RemoteError(f"{file}: has changed while it was fetched")
        finally:
            self._under_way -= 1

    async def _part(self, file: str, offset: int) -> Answer:
        return await in_thread(lambda: self._client.record.part(file, offset, _TIMEOUT, _PART))


_KIND = "application/octet-stream"


class _Patient(StreamingResponse):
    """Streams to whoever takes it in time."""

    async def __call__(self, scope, receive, send) -> None:  # type: ignore[no-untyped-def]
        async def timed(message) -> None:  # type: ignore[no-untyped-def]
            async with asyncio.timeout(_TAKEN):
                await send(message)

        await super().__call__(scope, receive, timed)
