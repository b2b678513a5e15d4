"""The pages beside the code as one site.

pip install 'lidarboost[site]'
sphinx-build -W -c deploy/site . out/site
"""

from typing import Any

PAGES = (
    "deploy/README",
    "deploy/FAULTS",
    "service/messages/README",
    "drivers/README",
    "solver/README",
    "solver/FIGURES",
    "service/README",
    "CONTRIBUTING",
    "service/daemon/commands/README",
    "service/web/static/README",
    "service/web/vendor/README",
    "DECISIONS",
    "CHANGELOG",
)
"""As the site lists them; a code host shows each where its subject is."""

project = "lidarboost"
author = "the lidarboost authors"
copyright = "the lidarboost authors, Apache-2.0"

extensions = ["myst_parser"]
root_doc = "README"
include_patterns = [
    "*.md",
    "solver/*.md",
    "drivers/*.md",
    "service/README.md",
    "service/messages/*.md",
    "service/daemon/commands/*.md",
    "service/web/**/*.md",
    "deploy/*.md",
]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]  # links to code, which a code host shows and the site does not hold

html_theme = "furo"
html_title = "lidarboost"
html_show_sphinx = False
html_extra_path = ["start"]


def list_pages(_: Any, name: str, source: list[str]) -> None:
    """A table of contents, of which the README itself knows nothing."""
    if name == root_doc:
        source[0] += "\n```{toctree}\n:hidden:\n\n" + "\n".join(PAGES) + "\n```\n"


def setup(app: Any) -> None:
    app.connect("source-read", list_pages)
