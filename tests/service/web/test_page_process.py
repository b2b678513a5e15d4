"""The page's process beside the daemon, and by itself on the command line."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

import pytest
from commanding import configuration, running
from test_commands import hasty_rig
from typer.testing import CliRunner

from service.cli import app
from service.config.sections import Configuration
from service.daemon.page import PageKeeper, kept_page
from service.daemon.states import States
from service.errors import ConfigurationError

pytestmark = pytest.mark.slow

LIDARBOOST = [sys.executable, "-m", "lidarboost"]


@contextmanager
def viewing(*arguments: str, **environment: str) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """`lidarboost view --web`, and where it says that the page is."""
    command = [*LIDARBOOST, "view", "--web", "--port", "0", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | environment
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("page: http://127.0.0.1:")
            yield process, line.removeprefix("page: ").strip()
        finally:
            process.kill()


def answers(url: str) -> bool:
    try:
        with urlopen(url, timeout=10) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


@pytest.fixture
def keepers(monkeypatch: pytest.MonkeyPatch) -> list[PageKeeper]:
    """Every keeper that is made, so that its process can be found."""
    made: list[PageKeeper] = []
    start = PageKeeper.start

    def noted(self: PageKeeper) -> None:
        made.append(self)
        start(self)

    monkeypatch.setattr(PageKeeper, "start", noted)
    return made


def test_a_page_that_is_killed_or_hangs_is_started_again_and_ends_with_its_service(
    tmp_path: Path, endpoint: str, keepers: list[PageKeeper], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.daemon.page._ANSWER", 3.0)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = configuration(tmp_path, endpoint, web={"enabled": True, "port": port})
    with running(settings, hasty_rig()) as service:
        [keeper] = keepers
        service.wait(lambda: keeper.url is not None)
        url = keeper.url
        assert url == f"http://127.0.0.1:{port}/"
        assert answers(url)
        for blow in (signal.SIGKILL, signal.SIGSTOP):
            before = keeper.pid
            assert before is not None
            os.kill(before, blow)
            service.wait(lambda: keeper.url is None)
            assert service.daemon is not None
            assert any("live page" in fault.what for fault in service.daemon.states.degraded)
            service.wait(lambda: keeper.url == url)
            assert keeper.pid != before
            assert answers(url)
            assert service.daemon.states.degraded == ()
        assert service.daemon.states.state == "idle"
        last = keeper.pid
    assert last is not None
    with pytest.raises(ProcessLookupError):
        os.kill(last, 0)
    assert not answers(url)


def test_a_port_that_is_taken_degrades_the_page_alone_until_it_is_free(
    tmp_path: Path, endpoint: str, keepers: list[PageKeeper]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        settings = configuration(tmp_path, endpoint, web={"enabled": True, "port": port})
        with running(settings, hasty_rig()) as service:
            assert service.daemon is not None
            states: States = service.daemon.states
            service.wait(lambda: bool(states.degraded))
            [fault] = states.degraded
            assert f"cannot listen on 127.0.0.1, port {port}" in fault.what
            taken.close()
            service.wait(lambda: keepers[0].url is not None)
            assert states.degraded == ()


def test_a_service_without_a_page_starts_none(
    tmp_path: Path, endpoint: str, keepers: list[PageKeeper]
) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()):
        assert keepers == []


def test_the_page_on_the_command_line_says_where_it_is_and_ends_when_told(endpoint: str) -> None:
    with viewing("--endpoint", endpoint) as (process, url):
        assert answers(url)
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
        assert time.monotonic() - began < 10


def test_the_token_comes_from_the_environment_and_is_part_of_the_link(endpoint: str) -> None:
    with viewing("--endpoint", endpoint, LIDARBOOST_WEB__TOKEN="guess/me if you can") as (_, url):
        assert url.endswith("/?token=guess%2Fme%20if%20you%20can")
        assert not answers(url.partition("?")[0])
        assert b"app.js" in urlopen_with_cookies(url)


def urlopen_with_cookies(url: str) -> bytes:
    from http.cookiejar import CookieJar
    from urllib.request import HTTPCookieProcessor, build_opener

    with build_opener(HTTPCookieProcessor(CookieJar())).open(url, timeout=10) as answer:
        content: bytes = answer.read()
        return content


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--host", "0.0.0.0"], r"can be reached by others: set --token"),
        (["--token", "short"], r"--token: .*12 to 200 printable"),
        (["--endpoint", "nowhere"], r"Zenoh refuses an endpoint"),
        (["--host", "203.0.113.77", "--token", "a token of twelve"], r"cannot listen on 203\.0\.113\.77"),
    ],
)
def test_what_cannot_be_served_is_said_in_one_line(arguments: list[str], said: str) -> None:
    result = CliRunner().invoke(app, ["view", "--web", "--port", "0", *arguments])
    assert result.exit_code in (1, 2)
    [line] = result.stderr.strip().splitlines()
    assert re.search(said, line), line


def test_a_page_shows_a_rig_and_no_file(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["view", str(tmp_path / "a.mcap"), "--web"])
    assert result.exit_code == 2
    assert "load a recording on its page" in result.stderr


def test_what_the_page_needs_is_named_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("service.versions.find_spec", lambda name: None if name == "uvicorn" else object())
    done = CliRunner().invoke(app, ["view", "--web"])
    assert (done.exit_code, done.stderr) == (
        2,
        "error: uvicorn not installed: pip install 'lidarboost[web]'\n",
    )
    with (
        pytest.raises(ConfigurationError, match=r"pip install 'lidarboost\[web\]'"),
        kept_page(Configuration(), States()),
    ):
        pass
