"""Who may see the page: the token, foreign names and origins, paths that climb, too much of anything."""

import gzip
import json
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest
from browsing import TOKEN, ask, opened, served, socket_url
from pydantic import ValidationError
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from service.web.options import PageOptions
from service.web.server import PageServer

LOGIN = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def page(free_endpoint: Callable[[], str]) -> Iterator[PageServer]:
    with served(free_endpoint()) as page:
        yield page


@pytest.fixture
def guarded(free_endpoint: Callable[[], str]) -> Iterator[PageServer]:
    with served(free_endpoint(), token=TOKEN) as page:
        yield page


def test_the_page_and_its_files_come_packed_and_with_headers_that_bind_the_browser(page: PageServer) -> None:
    index = ask(page, "/", {"Accept-Encoding": "gzip"})
    assert index.status == 200
    assert b"<!doctype html>" in gzip.decompress(index.content).lower()
    assert "default-src 'none'" in index.headers["content-security-policy"]
    assert "unsafe" not in index.headers["content-security-policy"]
    assert index.headers["x-content-type-options"] == "nosniff"
    assert index.headers["cross-origin-resource-policy"] == "same-origin"
    again = ask(page, "/", {"If-None-Match": index.headers["etag"]})
    assert (again.status, again.content) == (304, b"")
    assert ask(page, "/static/app.js").headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "/static//etc/passwd",
        "/vendor/fetch.py",
        "/static/app.js%00.html",
        "/server.py",
        "/static",
        "/bursts/../static/app.js.png",
    ],
)
def test_paths_that_climb_lead_nowhere(page: PageServer, path: str) -> None:
    answer = ask(page, path)
    assert answer.status == 404
    assert answer.told["code"] == "NOT_FOUND"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8470", "", "127.0.0.1.evil.example", "["])
def test_another_name_for_this_machine_is_refused(page: PageServer, host: str) -> None:
    answer = ask(page, "/", {"Host": host})
    assert answer.status in (400, 403)
    if answer.status == 403:
        assert "is not this machine" in answer.told["message"]


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9000", "127.0.0.1:1", "[::1]:8470"])
def test_its_own_names_are_served(page: PageServer, host: str) -> None:
    assert ask(page, "/", {"Host": host}).status == 200


def test_pages_of_other_origins_are_refused(page: PageServer) -> None:
    assert ask(page, "/", {"Origin": "http://evil.example"}).status == 403
    assert ask(page, "/", {"Origin": "null"}).status == 403
    assert ask(page, "/", {"Origin": page.url.rstrip("/")}).status == 200
    with pytest.raises(InvalidStatus, match="403"), connect(socket_url(page), origin="http://localhost:1"):
        pass
    own = page.url.rstrip("/")
    with connect(socket_url(page), origin=own, max_size=None) as socket:  # type: ignore[arg-type]
        assert json.loads(socket.recv(10))["type"] == "hello"


def test_without_the_token_there_is_a_form_and_nothing_else(guarded: PageServer) -> None:
    assert ask(guarded, "/").status == 401
    assert b"token" in ask(guarded, "/").content
    assert ask(guarded, "/static/login.js").status == 200  # what the form is made of is no secret
    for path in ("/recordings/a.mcap", "/bursts/1.png"):
        assert ask(guarded, path).status == 401
    with opened(guarded) as browser, pytest.raises(ConnectionClosed) as closed:
        browser.receive()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4401


def test_the_token_is_exchanged_for_a_cookie(guarded: PageServer) -> None:
    body = json.dumps({"token": TOKEN}).encode()
    answer = ask(guarded, "/login", LOGIN, "POST", body)
    assert answer.status == 204
    told = answer.headers["set-cookie"]
    assert "HttpOnly" in told
    assert "SameSite=Strict" in told
    assert TOKEN not in told
    cookie = {"Cookie": told.partition(";")[0]}
    assert ask(guarded, "/", cookie).status == 200
    assert ask(guarded, "/bursts/1.png", cookie).status == 404
    with opened(guarded, cookie) as browser:
        assert browser.receive()["type"] == "hello"
    assert ask(guarded, "/bursts/1.png", {"Authorization": f"Bearer {TOKEN}"}).status == 404
    link = ask(guarded, f"/?token={TOKEN.replace(' ', '%20')}")
    assert (link.status, link.headers["location"]) == (303, "/")
    assert link.headers["set-cookie"] == told


def test_what_is_not_the_token_opens_nothing(guarded: PageServer) -> None:
    nested = b"[" * 4000
    for told in (
        b'{"token": "wrong"}',
        b'{"token": "\\ud800"}',
        b'{"token": 5}',
        b"[]",
        b"{",
        b"\xff",
        nested,
        b"",
    ):
        answer = ask(guarded, "/login", LOGIN, "POST", told)
        assert answer.status in (400, 401)
        assert "set-cookie" not in answer.headers
    name = f"lidarboost-{guarded.url.rsplit(':')[-1].strip('/')}"
    for cookie in (f"{name}=wrong", f"{name}=", f"{name}", "=;=;", "ü=ü"):
        assert ask(guarded, "/bursts/1.png", {"Cookie": cookie}).status == 401
    for bearer in ("wrong", "", "ü"):
        assert ask(guarded, "/bursts/1.png", {"Authorization": f"Bearer {bearer}"}).status == 401


def test_guessing_is_slow_and_a_long_guess_is_cut_short(guarded: PageServer) -> None:
    assert ask(guarded, "/login", LOGIN, "POST", b" " * 10_000).status == 413
    answers = [ask(guarded, "/login", LOGIN, "POST", b'{"token": "guess"}').status for _ in range(12)]
    assert answers[0] == 401
    assert answers[-1] == 429
    assert (
        ask(guarded, f"/?token={TOKEN.replace(' ', '%20')}").status == 401
    )  # not now, not even the right one


def test_who_can_be_reached_by_others_needs_a_token() -> None:
    for host in ("0.0.0.0", "::", "192.168.1.5", "rig.example"):
        with pytest.raises(ValidationError, match=r"set web\.token"):
            PageOptions(host=host)
        assert not PageOptions(host=host, token=TOKEN).is_loopback
    for token in ("short", "x" * 201, "schlüssel für alle"):
        with pytest.raises(ValidationError, match="12 to 200 printable"):
            PageOptions(token=token)
    assert TOKEN not in repr(PageOptions(token=TOKEN))
    assert TOKEN not in PageOptions(token=TOKEN).model_dump_json()


def test_huge_requests_are_refused_and_the_next_one_is_served(page: PageServer) -> None:
    for path, headers in (("/", {"X-Much": "x" * 200_000}), ("/static/" + "a" * 200_000, {})):
        with suppress(ConnectionError):  # it may be cut off before it has read the answer
            assert ask(page, path, headers).status == 400
    assert ask(page, "/", method="DELETE").status == 405
    assert ask(page, "/").status == 200
