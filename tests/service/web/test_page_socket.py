"""The WebSocket of a page: what it is told, how slow, silent, broken or many ones are borne."""

import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from urllib.parse import urlsplit

import numpy as np
import pytest
from browsing import Browser, Image, ask, opened, served
from publishing import publishing
from websockets.exceptions import ConnectionClosed

from service.messages.encoding import fused_messages
from service.messages.map import FusedMap
from service.sinks.publisher import Publisher
from service.web import connections, server, sockets
from service.web.server import PageServer
from service.wire.session import open_session


@dataclass(frozen=True)
class Watched:
    """A page of something that publishes maps."""

    page: PageServer
    publisher: Publisher
    fused: Callable[[int], FusedMap]

    def publish(self, number: int) -> FusedMap:
        """A map whose depth grows with its number."""
        made = self.fused(number)
        made = replace(made, depth=made.depth + np.float32(number))
        self.publisher.publish(fused_messages(made))
        return made


@contextmanager
def watching(endpoint: str, fused: Callable[[int], FusedMap]) -> Iterator[Watched]:
    with open_session([endpoint]) as session, publishing(session) as publisher, served(endpoint) as page:
        yield Watched(page, publisher, fused)


@pytest.fixture
def watched(endpoint: str, fused: Callable[[int], FusedMap]) -> Iterator[Watched]:
    with watching(endpoint, fused) as watched:
        yield watched


def test_a_page_is_greeted_then_shown_the_newest_map_once_it_has_drawn_the_last(watched: Watched) -> None:
    first = watched.publish(1)
    with opened(watched.page) as browser:
        kinds = [browser.receive()["type"] for _ in range(5)]
        assert kinds == ["hello", "link", "history", "log", "bursts"]
        browser.show("fused/depth", "fused/deviation")
        image = browser.until(lambda m: isinstance(m, Image) and m.header["topic"] == "fused/depth")
        np.testing.assert_allclose(image.values, first.depth, atol=1e-4)
        np.testing.assert_allclose(image.header["intrinsics"], first.intrinsics.ravel())
        assert browser.image("fused/deviation").header["unit"] == "m"
        for number in (2, 3, 4):
            watched.publish(number)
        browser.until(lambda m: isinstance(m, dict) and m["type"] == "burst" and m["burst"]["burst"] == 4)
        browser.send(type="ack", topic="fused/depth")
        newest = browser.image("fused/depth")
        assert np.nanmax(newest.values) == pytest.approx(np.nanmax(first.depth) + 3, abs=1e-3)
        browser.show()
        watched.publish(5)
        browser.show("fused/depth")  # begins anew, whatever was not acknowledged
        while np.nanmax(browser.image("fused/depth").values) < np.nanmax(first.depth) + 3.5:
            pass


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{",
        "[]",
        '"show"',
        "null",
        '{"type": "leap"}',
        '{"type": "show"}',
        '{"type": "show", "images": "fused/depth"}',
        '{"type": "show", "images": ["../status"]}',
        '{"type": "ack", "topic": 5}',
        '{"type": "command", "id": 1, "name": "manifest", "action": "get"}',
        '{"type": "command", "id": 1, "name": "cmd/../x", "action": "get"}',
        '{"type": "command", "id": 1, "name": "cmd/scan", "action": "once", "timeout": 1e9}',
        '{"type": "command", "id": 1, "name": "cmd/scan", "action": "once", "arguments": {"a": NaN}}',
        '{"type": "ack", "topic": "' + "x" * 1000 + '"}',
        "[" * 30_000,
    ],
)
def test_a_malformed_message_is_answered_and_the_page_goes_on(message: str, shared: Watched) -> None:
    with opened(shared.page) as browser:
        browser.socket.send(message)
        error = browser.told("error")
        assert (error["id"], error["code"]) == (None, "INVALID_ARGUMENT")
        assert len(error["message"]) < 500
        browser.send(type="show", images=["fused/depth"])
        browser.image("fused/depth")


@pytest.fixture(scope="module")
def shared(free_endpoint: Callable[[], str], _fused: FusedMap) -> Iterator[Watched]:
    with watching(free_endpoint(), lambda _: _fused) as watched:
        watched.publish(1)
        yield watched


def closed_with(browser: Browser) -> int:
    """The code that the server closes it with."""
    with pytest.raises(ConnectionClosed) as closed:
        browser.until(lambda _: False)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code


def test_huge_binary_and_too_many_messages_end_the_page_and_no_other(shared: Watched) -> None:
    with opened(shared.page) as bystander:
        with opened(shared.page) as browser:
            browser.socket.send("x" * 100_000)
            assert closed_with(browser) == 1009
        with opened(shared.page) as browser:
            browser.socket.send(b"bytes")
            assert closed_with(browser) == 1008
        with opened(shared.page) as browser, ExitStack() as stack:
            stack.enter_context(pytest.raises(ConnectionClosed))
            for _ in range(1000):
                browser.send(type="ack", topic="fused/depth")
            stack.pop_all()
            assert closed_with(browser) == 1008
        bystander.show("fused/depth")
        bystander.image("fused/depth")


def raw_page(page: PageServer, receive_buffer: int) -> socket.socket:
    """A browser that has opened the page, asked for maps, and reads nothing from then on."""
    place = urlsplit(page.url)
    peer = socket.socket()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    peer.connect((place.hostname, place.port))
    key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
    upgrade = f"Host: {place.netloc}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n{key}"
    peer.sendall(f"GET /ws HTTP/1.1\r\n{upgrade}\r\n".encode())
    assert peer.recv(12) == b"HTTP/1.1 101"
    for text in ('{"type":"show","images":["fused/depth"]}', *['{"type":"ack","topic":"fused/depth"}'] * 40):
        peer.sendall(struct.pack("!BB4s", 0x81, 0x80 | len(text), b"\0\0\0\0") + text.encode())
    return peer


def send_for_long(peer: socket.socket, content: bytes) -> None:
    end = time.monotonic() + 30
    while time.monotonic() < end:
        peer.send(content)
        time.sleep(0.02)


def test_browsers_that_sleep_or_vanish_hold_up_nobody(
    watched: Watched,
) -> None:
    sleepers = [raw_page(watched.page, 4096) for _ in range(5)]
    with opened(watched.page) as browser:
        browser.show("fused/depth")
        for number in range(1, 40):
            made = watched.publish(number)
            if number == 20:  # with a reset, as a browser that is killed
                sleepers[0].setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                sleepers.pop(0).close()
            image = browser.image("fused/depth", timeout=20)
            assert np.nanmax(image.values) == pytest.approx(np.nanmax(made.depth), abs=1e-3)
    for sleeper in sleepers:
        sleeper.close()


def test_a_browser_that_answers_no_ping_is_cut_off(
    endpoint: str, fused: Callable[[int], FusedMap], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_PING", 0.3)
    with watching(endpoint, fused) as watched:
        sleeper = raw_page(watched.page, 4096)
        for number in range(50):
            watched.publish(number)
        with sleeper, pytest.raises(OSError, match=r"reset|[Bb]roken pipe"):
            send_for_long(sleeper, b"\x8a\x80\0\0\0\0")  # a pong that nobody asked for


def test_a_hundred_idle_connections_leave_room_and_go(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "_REQUEST", 0.5)
    place = urlsplit(watched.page.url)
    idle = [socket.create_connection((place.hostname, place.port)) for _ in range(100)]
    idle[0].sendall(b"GET / HTTP/1.1\r\nHost: local")  # one that never ends its request
    assert ask(watched.page, "/").status == 200
    for connection in idle:
        connection.settimeout(20)
        with suppress(ConnectionResetError):
            assert connection.recv(1) == b""
        connection.close()


def test_of_too_many_pages_the_quietest_makes_room(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets, "MOST", 4)
    with ExitStack() as stack:
        browsers = [stack.enter_context(opened(watched.page)) for _ in range(4)]
        for browser in browsers:
            assert browser.receive()["type"] == "hello"
        for browser in (browsers[0], browsers[2], browsers[3]):
            browser.show("fused/depth")
        watched.publish(1)
        browsers[3].image("fused/depth")
        newest = stack.enter_context(opened(watched.page))
        assert newest.receive()["type"] == "hello"
        assert closed_with(browsers[1]) == 4408
        newest.show("fused/depth")
        newest.image("fused/depth")
        browsers[0].image("fused/depth")
