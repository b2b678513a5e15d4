"""How quick the live page is in a browser: `python tests/benchmarks/browser.py [--seconds 5] [--opened 5]`.

A simulated rig sees the scene `objects` and fuses it into 704 × 576 points; a headless Chromium without a
graphics card opens the page and turns the surface by keys, one step for each picture of the browser. Printed
as JSON: pictures per second while it turns (a mesh of half the rows and columns), seconds from the opening
of the page to its first map (each opening with an empty cache), and seconds from the server's receipt of a
map to its picture on the page. Run it on an idle machine.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "browser"))

from pages import Page
from rigs import Rig, wait

_WATCH = """
window.shown = [];
new MutationObserver((changes) => changes.forEach(({target}) => {
  if (target.closest?.(".stage") && target.dataset.published) requestAnimationFrame(() => shown.push({
    opened: performance.now() / 1000, late: Date.now() / 1000 - Number(target.dataset.published)}));
})).observe(document, {subtree: true, attributes: true, attributeFilter: ["data-published"]});
"""

_TURN = """
const [seconds, done] = arguments, view = document.querySelector(".surface-view");
const begun = performance.now(), before = Number(view.dataset.drawn);
const turn = () => {
  view.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight", bubbles: true}));
  const passed = (performance.now() - begun) / 1000;
  if (passed < seconds) requestAnimationFrame(turn);
  else done((Number(view.dataset.drawn) - before) / passed);
};
turn();
"""


def turning(page: Page, seconds: float) -> float:
    """Pictures per second while the surface turns all the time."""
    wait(lambda: page.find(".surface-view").get_attribute("data-fine") == "true")
    page.driver.set_script_timeout(seconds + 30)
    rate: float = page.driver.execute_async_script(_TURN, seconds)
    return rate


def opening(url: str) -> float:
    """Seconds from the opening of the page to its first map."""
    with Page("about:blank") as page:
        page.tell("Page.addScriptToEvaluateOnNewDocument", source=_WATCH)
        page.driver.get(url)
        wait(lambda: page.ask("return window.shown?.length ?? 0") > 0)
        opened: float = page.ask("return shown[0].opened")
        return opened


def delays(page: Page, maps: int) -> list[float]:
    """Seconds from the server's receipt of a map to its picture."""
    page.tell("Page.addScriptToEvaluateOnNewDocument", source=_WATCH)
    page.driver.refresh()
    wait(lambda: page.ask("return shown.length") > 0)
    for _ in range(maps):
        before = page.ask("return shown.length")
        page.click("Once", ".actions")
        wait(lambda before=before: page.ask("return shown.length") > before, 120)
        time.sleep(0.5)
    found: list[float] = page.ask("return shown.slice(1).map((one) => one.late)")
    return found


def measure(seconds: float, opened: int) -> dict[str, Any]:
    """All figures."""
    with tempfile.TemporaryDirectory() as folder, Rig(Path(folder), "objects", "auto", 15, True) as rig:
        with Page(rig.url) as page:
            wait(lambda: page.state == "idle", 180)
            page.click("Once", ".actions")
            wait(lambda: page.map_number() > 0, 180)
            rate = turning(page, seconds)
            late = delays(page, opened)
        first = [opening(rig.url) for _ in range(opened)]
    return {
        "pictures_per_second": round(rate, 1),
        "first_picture_seconds": {
            "median": round(statistics.median(first), 3),
            "longest": round(max(first), 3),
        },
        "map_to_picture_seconds": {
            "median": round(statistics.median(late), 3),
            "longest": round(max(late), 3),
        },
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--opened", type=int, default=5)
    given = parser.parse_args()
    print(json.dumps(measure(given.seconds, given.opened), indent=2))


if __name__ == "__main__":
    main()
