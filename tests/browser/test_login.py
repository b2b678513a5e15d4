"""A page that is open beyond its host asks for its token."""

from collections.abc import Iterator

import pytest
from pages import Page
from rigs import free_port, wait

from service.web.options import PageOptions
from service.web.server import PageServer

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]

TOKEN = "correct horse battery staple"


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    with PageServer(PageOptions(port=0, endpoint=nowhere, token=TOKEN)) as server:
        yield server.url


def test_the_token_opens_the_page_and_nothing_else_does(url: str) -> None:
    with Page(url) as page:
        assert page.violations() == []
        page.find("#token").send_keys("wrong")
        page.click("Open the page")
        wait(lambda: page.text(".said") == "This is not the token.")
        page.find("#token").clear()
        page.find("#token").send_keys(TOKEN)
        page.click("Open the page")
        wait(lambda: page.state == "no rig")
        assert "127.0.0.1" in page.text(".state .reason")
        assert page.faults == []
