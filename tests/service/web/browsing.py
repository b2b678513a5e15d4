"""A page's server and what a browser does with it: requests as raw as need be, and one WebSocket."""

import http.client
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect

from service.web.options import PageOptions
from service.web.server import PageServer

TOKEN = "a token nobody guesses"


@contextmanager
def served(endpoint: str, **options: Any) -> Iterator[PageServer]:
    """A page of whatever listens on the endpoint."""
    with PageServer(PageOptions(endpoint=endpoint, port=0, **options)) as page:
        yield page


@dataclass(frozen=True)
class Answer:
    """What came of a request."""

    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def told(self) -> Any:
        return json.loads(self.content)


def ask(
    page: PageServer,
    path: str,
    headers: Mapping[str, str] | None = None,
    method: str = "GET",
    body: bytes | None = None,
) -> Answer:
    """One request on a connection of its own; the path goes out as it is."""
    connection = http.client.HTTPConnection(urlsplit(page.url).netloc, timeout=30)
    try:
        given = dict(headers or {})
        connection.putrequest(method, path, skip_host="Host" in given, skip_accept_encoding=True)
        if body is not None:
            given["Content-Length"] = str(len(body))
        for name, value in given.items():
            connection.putheader(name, value)
        connection.endheaders(body)
        response = connection.getresponse()
        return Answer(response.status, {k.lower(): v for k, v in response.getheaders()}, response.read())
    finally:
        connection.close()


@dataclass(frozen=True)
class Image:
    """A binary frame."""

    header: dict[str, Any]
    data: NDArray[Any]

    @property
    def values(self) -> NDArray[np.float64]:
        """As a browser computes them, NaN where unknown."""
        found = self.header["offset"] + self.header["scale"] * self.data.astype(np.float64)
        return np.where(self.data == 0, np.nan, found)


class Browser:
    """One open page."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self._number = 0

    def send(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def show(self, *topics: str) -> None:
        self.send(type="show", images=list(topics))

    def receive(self, timeout: float = 30.0) -> Any:
        """The next message: a dictionary, or an image."""
        message = self.socket.recv(timeout=timeout)
        return image_of(message) if isinstance(message, bytes) else json.loads(message)

    def until(self, wanted: Callable[[Any], bool], timeout: float = 60.0) -> Any:
        """The next message that is wanted; others are passed over."""
        end = time.monotonic() + timeout
        while not wanted(message := self.receive(max(0.01, end - time.monotonic()))):
            pass
        return message

    def told(self, kind: str, timeout: float = 60.0, **fields: Any) -> Any:
        """The next message of a type, with these fields."""
        return self.until(
            lambda m: (
                isinstance(m, dict)
                and m["type"] == kind
                and all(m[name] == value for name, value in fields.items())
            ),
            timeout,
        )

    def image(self, topic: str, timeout: float = 60.0) -> Image:
        """The next image of a topic; it is acknowledged."""
        found: Image = self.until(lambda m: isinstance(m, Image) and m.header["topic"] == topic, timeout)
        self.send(type="ack", topic=topic)
        return found

    def command(self, name: str, action: str, timeout: float = 60.0, **arguments: Any) -> Any:
        """The answer to a command, or its error."""
        self._number += 1
        self.send(
            type="command", id=self._number, name=name, action=action, arguments=arguments, timeout=timeout
        )
        number = self._number
        return self.until(
            lambda m: isinstance(m, dict) and m["type"] in ("answer", "error") and m["id"] == number, 90.0
        )


def image_of(frame: bytes) -> Image:
    length = int.from_bytes(frame[:4], "little")
    assert (4 + length) % 8 == 0
    header = json.loads(frame[4 : 4 + length])
    data = frame[4 + length :]
    if header["encoding"] == "deflate":
        import zlib

        data = zlib.decompress(data)
    pixels = np.frombuffer(data, header["dtype"]).reshape(header["height"], header["width"])
    return Image(header, pixels)


@contextmanager
def opened(page: PageServer, headers: Mapping[str, str] | None = None) -> Iterator[Browser]:
    """An open page in a browser."""
    # Read on while the test does something else, or no ping is answered.
    reading: dict[str, Any] = {"max_size": None, "max_queue": None}
    with connect(socket_url(page), additional_headers=dict(headers or {}), **reading) as socket:
        yield Browser(socket)


def socket_url(page: PageServer) -> str:
    return page.url.replace("http://", "ws://") + "ws"
