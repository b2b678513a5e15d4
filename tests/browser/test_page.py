"""The live page, worked as its user does: in a headless Chromium, against a simulated rig."""

import shutil
import time

import pytest
from pages import Page
from rigs import FAR, NEAR, ROOT, START, Rig, wait

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]


def fused(page: Page) -> None:
    """A map is there; one is made where there is none yet."""
    if page.map_number() == 0:
        wait(lambda: page.state == "idle")
        page.click("Once", ".actions")
        wait(lambda: page.map_number() > 0)


def point(page: Page, column: float, row: float) -> None:
    """Put the pointer at a place of the map, shares of its width and height."""
    from selenium.webdriver import ActionChains

    stage = page.find(".stage")
    size = stage.size
    offset = round((column - 0.5) * size["width"]), round((row - 0.5) * size["height"])
    ActionChains(page.driver).move_to_element_with_offset(stage, *offset).perform()


def metres(text: str) -> float:
    """The number of `2.013 m`."""
    number, unit = text.split()
    assert unit == "m"
    return float(number)


def probed(page: Page) -> str:
    return page.text(".readout .main dd")


def troubles(page: Page) -> int:
    """How many things the page says are degraded."""
    return int(page.ask("return document.querySelectorAll('.troubles li').length"))


def test_a_click_scans_and_the_map_appears(page: Page) -> None:
    page.click("Scan", ".actions")
    wait(lambda: page.state == "scanning")
    wait(lambda: page.map_number() > 0)
    wait(lambda: "pose" in page.text(".scan"))
    page.click("Cancel", ".actions")
    wait(lambda: page.state == "idle")
    assert page.ask("return document.querySelector('.thumbnails img').complete")
    assert page.faults == []


def test_the_probe_shows_the_true_metres(page: Page) -> None:
    fused(page)
    for column, expected in ((0.25, NEAR), (0.75, FAR)):
        point(page, column, 0.5)
        wait(lambda: probed(page).endswith("m"))
        assert metres(probed(page)) == pytest.approx(expected, abs=0.015)


_ALL_DARK = """
const done = arguments[0];
Promise.all([import("/static/store.js"), import("/static/images/picture.js")]).then(([store, {Picture}]) => {
  const {width, height} = store.images["fused/depth"].value;
  const header = {topic: "fused/reason", width, height, dtype: "uint8", unit: "", sequence: 1};
  const held = [store.offered.value, store.images["fused/reason"].value];
  store.offered.set([...new Set([...held[0], "fused/reason"])]);
  store.images["fused/reason"].set(new Picture(header, new Uint8Array(width * height).fill(2)));
  window.restore = () => { store.offered.set(held[0]); store.images["fused/reason"].set(held[1]); };
  done();
});
"""


def test_the_probe_says_why_nothing_is_known(page: Page) -> None:
    fused(page)
    page.driver.execute_async_script(_ALL_DARK)
    page.click("Reason", ".map")
    point(page, 0.6, 0.4)
    wait(lambda: "too dark" in page.text(".readout"))
    assert "contradicted" in page.text(".reason-key")
    assert page.violations() == []
    page.click("Depth", ".map")
    page.ask("restore()")


def test_the_probe_is_moved_by_keys(page: Page) -> None:
    from selenium.webdriver import Keys

    fused(page)
    point(page, 0.4, 0.5)
    page.find(".stage").send_keys(Keys.SHIFT + Keys.ARROW_RIGHT * 15)
    wait(lambda: metres(probed(page)) == pytest.approx(FAR, abs=0.015))


def test_a_line_gives_a_profile_over_the_step(page: Page) -> None:
    from selenium.webdriver import ActionChains

    fused(page)
    point(page, 0.2, 0.5)
    width = page.find(".stage").size["width"]
    ActionChains(page.driver).click_and_hold().move_by_offset(round(0.6 * width), 0).release().perform()
    wait(lambda: page.ask("return document.querySelector('.profile .chart')?.ariaLabel ?? ''") != "")
    told = page.find(".profile .chart").get_attribute("aria-label").split()
    low, high = float(told[told.index("from") + 1]), float(told[told.index("to") + 1])
    assert (low, high) == (pytest.approx(NEAR, abs=0.02), pytest.approx(FAR, abs=0.02))


def test_the_surface_turns_by_keys_and_is_drawn_finely_at_rest(page: Page) -> None:
    from selenium.webdriver import Keys

    fused(page)
    view = page.find(".surface-view")
    wait(lambda: view.get_attribute("data-fine") == "true")
    before, picture = int(view.get_attribute("data-drawn")), view.screenshot_as_png
    view.send_keys(Keys.ARROW_LEFT * 5)
    wait(lambda: int(view.get_attribute("data-drawn")) > before)
    wait(lambda: view.get_attribute("data-fine") == "true")
    assert view.screenshot_as_png != picture


def test_a_changed_setting_is_in_force(page: Page) -> None:
    page.click("Settings", ".tabs")
    wait(lambda: page.text("#form-settings label") != "")
    box = page.find("#settings-integration_time")
    box.clear()
    box.send_keys("0.2")
    page.click("Apply", "#form-settings")
    wait(lambda: "expected a number" in page.text("#form-settings .said"))
    box.clear()
    box.send_keys("0.011")
    page.click("Apply", "#form-settings")
    wait(lambda: page.text("#form-settings .said") == "In force.")
    page.click("Reload", "#form-settings")
    assert box.get_attribute("value") == "0.011"
    page.click("Health", ".tabs")


def test_the_check_tells_what_a_scan_would_give(page: Page) -> None:
    page.click("Check", ".tabs")
    page.click("Check the scan", ".check")
    wait(lambda: "Phases covered" in page.text(".check"))
    assert page.ask("return document.querySelectorAll('.histogram rect').length") == 16
    page.click("Health", ".tabs")


def test_a_recording_is_replayed_and_sought(page: Page, rig: Rig) -> None:
    shutil.copy(ROOT / "recordings" / "wedges.mcap", rig.recordings)
    page.click("Recordings", ".tabs")
    page.click("Look again", ".recordings")
    before = page.map_number()
    page.click("Replay wedges.mcap", ".files")
    wait(lambda: "wedges.mcap" in page.text(".player"))
    wait(lambda: page.map_number() > before)
    wait(lambda: "at its end" in page.text(".player"))
    page.click("Step back", ".player")
    wait(lambda: page.text(".player .number").startswith("0:00.0"))
    page.click("End", ".player")
    wait(lambda: page.text(".player") == "")
    wait(lambda: page.state == "idle")
    page.click("Health", ".tabs")


def test_a_torn_recording_is_recovered_and_a_whole_one_fetched(page: Page, rig: Rig) -> None:
    whole = (ROOT / "recordings" / "wedges.mcap").read_bytes()
    (rig.recordings / "whole.mcap").write_bytes(whole)
    (rig.recordings / "torn.mcap.active").write_bytes(whole[: len(whole) // 2])
    page.click("Recordings", ".tabs")
    page.click("Look again", ".recordings")
    page.click("Recover torn.mcap.active", ".files")
    wait(lambda: "a recording of its own" in page.text(".notices"))
    address = page.button("Download whole.mcap", ".files").get_attribute("href")
    size = page.driver.execute_async_script(
        "fetch(arguments[0]).then((got) => got.arrayBuffer()).then((got) => arguments[1](got.byteLength))",
        address,
    )
    assert size == len(whole)
    page.click("Health", ".tabs")


def test_what_is_refused_is_said(page: Page, rig: Rig) -> None:
    (rig.recordings / "noise.mcap").write_bytes(b"not a recording")
    page.click("Recordings", ".tabs")
    page.click("Look again", ".recordings")
    page.click("Replay noise.mcap", ".files")
    wait(lambda: "INVALID_ARGUMENT" in page.text(".notices"))
    (rig.recordings / "noise.mcap").unlink()
    page.click("Health", ".tabs")


def test_a_recording_that_breaks_off_shows_within_two_seconds(page: Page, rig: Rig) -> None:
    from lidarboost import Client

    page.click("Record", ".actions")
    wait(lambda: page.button("Stop recording", ".actions") is not None)
    before = troubles(page)
    with Client(rig.endpoint) as client, client.subscribe("status") as statuses:
        shutil.rmtree(rig.recordings)
        rig.recordings.write_text("not a folder")
        while not any("record" in one["what"] for one in statuses.receive(20).value["degraded"]):
            pass
        told = time.monotonic()
        wait(lambda: troubles(page) > before)
        assert time.monotonic() - told < 2
    rig.recordings.unlink()
    wait(lambda: troubles(page) == before)
    page.click("Stop recording", ".actions")
    wait(lambda: page.button("Record", ".actions") is not None)


def test_a_rig_that_dies_shows_within_two_seconds_and_is_followed_when_it_is_back(
    page: Page, rig: Rig
) -> None:
    rig.kill()
    assert wait(lambda: page.state == "no rig") < 2
    assert page.ask("return document.querySelector('main').classList.contains('old')")
    rig.start()
    wait(lambda: page.state == "idle", START)
    before = page.map_number()
    page.click("Once", ".actions")
    wait(lambda: page.map_number() != before)
    assert page.faults == []
