"""The example configurations of `deploy/rigs`: each can be used, and there is one for each kind of rig."""

import os
from pathlib import Path

import pytest

from drivers.backends import CAMERAS, STAGES
from service.capture.configured import check_options
from service.config.file import load

RIGS = sorted((Path(__file__).parents[2] / "deploy" / "rigs").glob("*.toml"))


@pytest.fixture(autouse=True)
def _no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.startswith("LIDARBOOST_"):
            monkeypatch.delenv(name)


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_an_example_can_be_used_as_it_is(path: Path) -> None:
    found = load(path)
    # The calibration is the site's own; all else is checked as `config check` does.
    camera = found.camera.model_copy(update={"calibration": None})
    check_options(found.model_copy(update={"camera": camera}))
    assert path.read_text(encoding="utf-8").startswith("# ")


def test_there_is_an_example_for_each_backend() -> None:
    found = [load(path) for path in RIGS]
    assert {one.camera.backend for one in found} == set(CAMERAS)
    assert {one.stage.backend for one in found} == set(STAGES)
