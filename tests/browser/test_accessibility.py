"""The page on a desk, a tablet and a phone, in light and dark: usable, and axe finds no violation."""

import pytest
from pages import Page
from rigs import START, Rig, wait

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]

SIZES = {"desk": (1440, 900, False), "tablet": (820, 1180, True), "phone": (390, 844, True)}
TABS = ("Health", "Settings", "Recordings", "Check", "Log")


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_axe_finds_no_violation(rig: Rig, size: str, dark: bool) -> None:
    width, height, finger = SIZES[size]
    with Page(rig.url, width, height, dark, finger) as page:
        wait(lambda: page.state == "idle", START)
        if page.map_number() == 0:
            page.click("Once", ".actions")
            wait(lambda: page.map_number() > 0)
        for tab in TABS:
            page.click(tab, ".tabs")
            wait(lambda tab=tab: page.text("[role=tab][aria-selected=true]").startswith(tab))
            page.ask("document.querySelectorAll('details').forEach((part) => (part.open = true))")
            assert page.violations() == [], tab
        assert page.ask("return document.documentElement.scrollWidth") <= width
        assert page.faults == []


def test_everything_is_reached_by_keys(rig: Rig) -> None:
    from selenium.webdriver import Keys

    with Page(rig.url) as page:
        wait(lambda: page.state == "idle", START)
        reached = set()
        for _ in range(60):
            page.driver.switch_to.active_element.send_keys(Keys.TAB)
            script = "return document.activeElement.className || document.activeElement.innerText.trim()"
            reached.add(page.ask(script))
        assert {"stage ", "surface-view", "primary", "Health"} <= reached
        page.find("[role=tab][aria-selected=true]").send_keys(Keys.ARROW_RIGHT)
        assert page.driver.switch_to.active_element.text == "Settings"
        assert page.text("[role=tab][aria-selected=true]") == "Settings"
