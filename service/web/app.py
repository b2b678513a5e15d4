"""The routes of the page."""

import json
from collections.abc import Awaitable, Callable
from http import HTTPStatus

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from service.web.access import Access
from service.web.assets import Asset, assets
from service.web.downloads import Downloads
from service.web.gate import Gate
from service.web.hub import Hub
from service.web.page_socket import UNKNOWN
from service.web.refusals import refusal
from service.web.sockets import Sockets

_INDEX, _LOGIN = "static/index.html", "static/login.html"

_LOGIN_SIZE = 4096
"""Bytes of a request that tells the token."""

Endpoint = Callable[[Request], Awaitable[Response]]


def make_app(access: Access, hub: Hub, sockets: Sockets, downloads: Downloads) -> ASGIApp:
    """The application: pages and files, pictures and downloads, one WebSocket a page."""
    door = _Door(access)

    async def burst(request: Request) -> Response:
        picture = hub.thumbnails.picture(request.path_params["key"])
        if picture is None:
            return refusal(404, "NOT_FOUND", "this burst is not kept any more")
        return Response(
            picture, headers={"cache-control": "private, max-age=31536000, immutable"}, media_type="image/png"
        )

    async def page(socket: WebSocket) -> None:
        await socket.accept()
        if access.admits(socket.headers):
            await sockets.serve(socket)
        else:
            await socket.close(UNKNOWN)

    routes = [
        Route("/", door.index),
        Route("/login", door.login, methods=["POST"]),
        Route("/static/{path:path}", _asset),
        Route("/vendor/{path:path}", _asset),
        Route("/bursts/{key}.png", door.guarded(burst)),
        Route("/recordings/{file:path}", door.guarded(downloads.answer)),
        WebSocketRoute("/ws", page),
    ]
    behind = Starlette(routes=routes, exception_handlers={HTTPException: _refused})
    behind.router.redirect_slashes = False
    return Gate(behind, access)


class _Door:
    """Asks for the token where one is needed.

    Args:
        access: knows it.
    """

    def __init__(self, access: Access) -> None:
        self._access = access

    async def index(self, request: Request) -> Response:
        """The page, or what asks for the token; a link that brings it is answered with the cookie."""
        told = request.query_params.get("token")
        if told is not None and self._may_try(request) and self._access.is_token(told):
            return RedirectResponse("/", 303, {"set-cookie": self._access.cookie(request.headers)})
        if self._access.admits(request.headers):
            return _named(_INDEX).answer(request)
        return _named(_LOGIN).answer(request, 401)

    async def login(self, request: Request) -> Response:
        """`{"token"}` in exchange for the cookie."""
        if not self._may_try(request):
            headers = {"retry-after": "10"}
            return refusal(429, "UNAVAILABLE", "too many tries: wait ten seconds", headers)
        content = b""
        async for chunk in request.stream():
            content += chunk
            if len(content) > _LOGIN_SIZE:
                return refusal(413, "INVALID_ARGUMENT", f"expected at most {_LOGIN_SIZE} bytes")
        try:
            told = json.loads(content)["token"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return refusal(400, "INVALID_ARGUMENT", 'expected {"token": "…"}')
        if not isinstance(told, str) or not self._access.is_token(told):
            return refusal(401, "PERMISSION_DENIED", "this is not the token of this rig's page")
        return Response(status_code=204, headers={"set-cookie": self._access.cookie(request.headers)})

    def guarded(self, endpoint: Endpoint) -> Endpoint:
        """The same for those alone who have told the token."""

        async def checked(request: Request) -> Response:
            if self._access.admits(request.headers):
                return await endpoint(request)
            return refusal(401, "PERMISSION_DENIED", "tell the token first: open / in a browser")

        return checked

    def _may_try(self, request: Request) -> bool:
        return self._access.may_try("" if request.client is None else request.client.host)


async def _asset(request: Request) -> Response:
    return _named(request.url.path.removeprefix("/")).answer(request)


def _named(path: str) -> Asset:
    found = assets().get(path)
    if found is None:
        raise HTTPException(404)
    return found


async def _refused(_: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 500
    code = "NOT_FOUND" if status == 404 else "INVALID_ARGUMENT"
    headers = error.headers if isinstance(error, HTTPException) else None
    return refusal(status, code, HTTPStatus(status).phrase.lower(), headers)
