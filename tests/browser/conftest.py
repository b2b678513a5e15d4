import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from pages import Page
from rigs import START, Rig, wait


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A simulated rig that sees a step of 0.5 m, idle, and its page."""
    with Rig(tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(scope="module")
def page(rig: Rig) -> Iterator[Page]:
    """The page on a desk, the rig idle."""
    with Page(rig.url) as shown:
        wait(lambda: shown.state == "idle", START)
        yield shown
