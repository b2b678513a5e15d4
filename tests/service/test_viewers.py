"""Recordings and rigs in viewers that others made: readers of MCAP, Rerun, and the layouts for them."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import pytest
from publishing import publishing
from typer.testing import CliRunner

from service.cli import app
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.messages.topics import TOPICS
from service.wire.session import open_session

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
VIEWERS = ROOT / "deploy" / "viewers"


def lidarboost(*words: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file made by `run`: frames, maps, log and status."""
    folder = tmp_path_factory.mktemp("viewers")
    config = folder / "rig.toml"
    zenoh = folder / "zenoh.json5"
    zenoh.write_text('{listen: {endpoints: ["tcp/127.0.0.1:0"]}}')
    config.write_text(
        f'[zenoh]\nconfig = "{zenoh}"\n[fusion]\nmethod = "nearest"\n[output]\npreview = false\n'
    )
    command = [sys.executable, "-m", "lidarboost", "run", config, "--once", "--output", folder / "out"]
    command += ["--replay", ROOT / "recordings" / "wedges.mcap"]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=500)
    return folder / "out" / "fused.mcap"


@pytest.fixture(scope="module")
def node_modules() -> Path:
    """Whose `node_modules`, named by `MCAP_MODULES`, has @mcap/core, @mcap/support and @mcap/nodejs."""
    modules = Path(os.environ.get("MCAP_MODULES", ""))
    if shutil.which("node") is None or not (modules / "@mcap" / "core").exists():
        pytest.skip("needs node, and MCAP_MODULES with @mcap/core, @mcap/support and @mcap/nodejs")
    return modules.resolve().parent


@pytest.mark.slow
def test_the_mcap_projects_own_readers_decode_every_topic(recorded: Path, node_modules: Path) -> None:
    command = ["node", HERE / "read_mcap.mjs", node_modules, recorded]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    wanted = {f"/{name}" for name, topic in TOPICS.items() if topic.recorded}
    # Not every method gives an amplitude, and so short a run may end before a second has passed.
    assert wanted - found.keys() <= {"/fused/amplitude", "/status"}
    assert found["/camera/distance"]["count"] == 15
    assert found["/fused/depth_mm"] == {
        "count": 1, "frame": "fused", "encoding": "16UC1", "bytes": 704 * 576 * 2
    }  # fmt: skip
    assert found["/fused/transform"]["frame"] == "fused"
    assert 0 < found["/fused/points"]["bytes"] <= 176 * 144 * 20


@pytest.mark.slow
def test_rerun_finds_nothing_wrong_with_it(recorded: Path) -> None:
    """By what it prints: its status is 0 regardless."""
    rerun_cli = pytest.importorskip("rerun_cli")
    command = [Path(rerun_cli.__file__).with_name("rerun"), "mcap", "check", "--full", recorded]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    rows = re.findall(r"^(\S+)\s+\d+\s+\d+\s+(/\S+)\s+(.*)$", done.stdout, flags=re.M)
    assert len(rows) >= 14, done.stdout + done.stderr
    assert {(status, issue.strip()) for status, _, issue in rows} == {("ok", "—")}, done.stdout


def _can_render() -> bool:
    return any(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*"))


@pytest.mark.slow
@pytest.mark.skipif(not _can_render(), reason="needs Mesa's software renderer for Vulkan")
def test_rerun_shows_the_map_where_it_belongs(recorded: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    drawn = tmp_path / "map.png"
    status, said, errors = lidarboost("view", recorded, "--picture", drawn)
    assert (status, said) == (0, f"wrote {drawn}\n"), errors
    _shows_colours(drawn)


@pytest.mark.slow
@pytest.mark.skipif(not _can_render(), reason="needs Mesa's software renderer for Vulkan")
def test_rerun_shows_a_running_rig(endpoint: str, fused: Callable[[int], FusedMap], tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    drawn, done = tmp_path / "live.png", []
    words = ("view", "--picture", drawn, "--endpoint", endpoint)
    with open_session(listen=(endpoint,)) as session, publishing(session) as publisher:
        publisher.take(MapFused(fused(1), None))
        showing = Thread(target=lambda: done.append(lidarboost(*words)))
        showing.start()
        showing.join(200)
        assert not showing.is_alive()
    assert done[0][0] == 0, done[0][2]
    assert cv2.imread(str(drawn)).shape == (1080, 1920, 3)


def test_view_tells_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.mcap").write_bytes(b"nothing")
    status, _, errors = lidarboost("view", tmp_path / "x.mcap")
    assert (status, errors.startswith("error: ")) == (1, True)
    monkeypatch.setitem(sys.modules, "rerun", None)
    status, _, errors = lidarboost("view", ROOT / "recordings" / "wedges.mcap")
    assert (status, "pip install 'lidarboost[rerun]'" in errors) == (2, True)


def test_layouts_name_topics_that_there_are() -> None:
    for name in ("lichtblick", "foxglove"):
        text = (VIEWERS / f"{name}.json").read_text(encoding="utf-8")
        named = set(re.findall(r'"/([a-z]+/[a-z_]+|log|status)"', text))
        assert named >= {"fused/points", "fused/depth_mm", "fused/calibration", "camera/amplitude", "log"}
        assert named <= TOPICS.keys()


def test_layouts_are_as_they_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("foxglove")
    monkeypatch.syspath_prepend(str(VIEWERS))
    import make

    assert (VIEWERS / "lichtblick.json").read_text(encoding="utf-8") == make.lichtblick()
    assert (VIEWERS / "foxglove.json").read_text(encoding="utf-8") == make.foxglove()


def _shows_colours(path: Path) -> None:
    """Whether more of the 3-D view is coloured than its axes: a map in the colours of its depths."""
    image = cv2.imread(str(path))[60:1000, :1100].astype(int)
    assert (np.ptp(image, axis=2) > 80).mean() > 0.1
