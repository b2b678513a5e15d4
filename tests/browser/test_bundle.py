"""What the page is made of: light, complete, licensed, and nothing from elsewhere."""

import gzip
import importlib.util
import json
import re

import pytest
from rigs import ROOT

from service.web.assets import assets

STATIC, VENDOR = ROOT / "service" / "web" / "static", ROOT / "service" / "web" / "vendor"
MOST = 1_500_000
SCRIPTS = sorted(STATIC.rglob("*.js"))


def test_the_page_is_light() -> None:
    served = [asset.content for asset in assets().values()]
    assert len(served) > 30
    assert sum(len(gzip.compress(content)) for content in served) < MOST / 10
    assert not [path for path in assets() if "axe" in path]


def test_the_bundled_libraries_are_what_they_are_said_to_be() -> None:
    specification = importlib.util.spec_from_file_location("fetch", VENDOR / "fetch.py")
    assert specification is not None
    assert specification.loader is not None
    fetch = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(fetch)
    assert fetch.main(check=True) == 0
    packages = json.loads((VENDOR / "versions.json").read_text(encoding="utf-8"))
    told = (VENDOR / "README.md").read_text(encoding="utf-8")
    for package in packages.values():
        assert package["version"] in told
        assert any(target.endswith("LICENSE.txt") for target in package["files"])


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: str(path.relative_to(STATIC)))
def test_modules_are_small_and_import_what_is_there(path) -> None:  # type: ignore[no-untyped-def]
    text = path.read_text(encoding="utf-8")
    assert text.count("\n") <= 250
    assert "innerHTML" not in text
    assert "eval(" not in text
    for name in re.findall(r'from "([^"]+)"', text):
        target = (path.parent / name).resolve()
        if name.startswith("../vendor") or "/vendor/" in name:
            target = VENDOR / name.rsplit("/", 1)[1]
        assert target.is_file(), name


def test_all_modules_of_the_page_are_loaded_at_once() -> None:
    index = (STATIC / "index.html").read_text(encoding="utf-8")
    told = set(re.findall(r'(?:href|src)="static/([^"]+\.js)"', index))
    own = {str(path.relative_to(STATIC)) for path in SCRIPTS}
    assert told == {name for name in own if not name.startswith("surface/") and name != "login.js"}


def test_nothing_comes_from_elsewhere() -> None:
    for path in [*SCRIPTS, *STATIC.rglob("*.html"), *STATIC.rglob("*.css")]:
        addresses = re.findall(r"(?:https?:)?//[\w.-]+\.\w+", path.read_text(encoding="utf-8"))
        assert [address for address in addresses if "w3.org" not in address] == [], path.name
    for path in STATIC.glob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert 'style="' not in text
        assert "<style" not in text
        assert not re.search(r"<script(?![^>]*\bsrc=)", text)
