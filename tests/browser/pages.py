"""The live page in a headless Chromium, as its user sees and works it."""

import shutil
from pathlib import Path
from typing import Any, Self

import pytest

AXE = Path(__file__).parents[2] / "service" / "web" / "vendor" / "testing" / "axe.min.js"

_FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars")

_RECORD = """
window.faults = [];
addEventListener("error", (event) => faults.push(event.message));
addEventListener("unhandledrejection", (event) => faults.push(String(event.reason)));
addEventListener("securitypolicyviolation", (event) => faults.push(`CSP: ${event.violatedDirective}`));
"""


class Page:
    """One browser with the page open.

    Args:
        url: of the page.
        width, height: of the window, CSS pixels.
        dark: what the system prefers.
        finger: a phone or tablet.
    """

    def __init__(
        self, url: str, width: int = 1440, height: int = 900, dark: bool = False, finger: bool = False
    ) -> None:
        webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")
        chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
        if chromium is None or driver is None:
            pytest.skip("needs chromium and chromium-driver")
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        for flag in (*_FLAGS, f"--window-size={width},{height}"):
            options.add_argument(flag)
        self.driver = webdriver.Chrome(options=options, service=Service(driver))
        self.tell("Page.addScriptToEvaluateOnNewDocument", source=_RECORD)
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": finger}
        self.tell("Emulation.setDeviceMetricsOverride", **size)
        if finger:
            self.tell("Emulation.setTouchEmulationEnabled", enabled=True)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.tell("Emulation.setEmulatedMedia", features=[scheme])
        self.driver.get(url)

    def tell(self, command: str, **arguments: Any) -> Any:
        """A command of the browser's own protocol."""
        return self.driver.execute_cdp_cmd(command, arguments)

    def ask(self, script: str, *arguments: Any) -> Any:
        """What a script returns."""
        return self.driver.execute_script(script, *arguments)

    def find(self, selector: str) -> Any:
        """The first element there is."""
        return self.driver.find_element("css selector", selector)

    def text(self, selector: str) -> str:
        """What an element says; empty where it is not there."""
        script = "return document.querySelector(arguments[0])?.innerText ?? ''"
        text: str = self.ask(script, selector)
        return text

    def button(self, name: str, within: str = "body") -> Any:
        """A button or link by its text or label; None where there is none that can be pressed."""
        script = """const [name, within] = arguments;
            return [...document.querySelectorAll(`${within} :is(button, a.button)`)].find((button) =>
            !button.disabled && [button.innerText, button.firstChild?.textContent, button.ariaLabel]
            .some((text) => text?.trim() === name)) ?? null"""
        return self.ask(script, name, within)

    def click(self, name: str, within: str = "body") -> None:
        """Press a button as soon as it can be."""
        from rigs import wait

        wait(lambda: self.button(name, within) is not None)
        self.ask("arguments[0].scrollIntoView({block: 'center'})", self.button(name, within))
        self.button(name, within).click()

    def map_number(self) -> int:
        """Counts the maps shown; 0 = none yet."""
        return int(self.ask("return document.querySelector('.stage canvas')?.dataset.sequence ?? 0"))

    @property
    def state(self) -> str:
        """Of the rig, as the page says."""
        return self.text(".state b")

    @property
    def faults(self) -> list[str]:
        """Errors of scripts and refusals by the content security policy."""
        found: list[str] = self.ask("return window.faults")
        return found

    def violations(self) -> list[str]:
        """What axe finds."""
        self.ask(AXE.read_text(encoding="utf-8"))
        found = self.driver.execute_async_script("axe.run(document).then(arguments[0])")
        return [
            f"{rule['id']}: {rule['help']} ({node['target']})"
            for rule in found["violations"]
            for node in rule["nodes"]
        ]

    def close(self) -> None:
        """End the browser."""
        self.driver.quit()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
