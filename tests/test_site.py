"""The pages beside the code build into one site."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = ("solver", "drivers", "service", "deploy")


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    for library in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(library, reason="needs lidarboost[site]")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-c", "deploy/site", ".", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert "README.html" in (tmp_path / "index.html").read_text(encoding="utf-8")
    pages = {path.relative_to(tmp_path) for path in tmp_path.rglob("*.html")}
    written = [page.relative_to(ROOT) for folder in FOLDERS for page in (ROOT / folder).rglob("*.md")]
    assert written
    assert {page.with_suffix(".html") for page in written} <= pages
