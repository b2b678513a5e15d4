"""What CONTRIBUTING.md says is all that there is to do."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from drivers import NotAvailableError, backends, make_camera, make_stage
from drivers.clock import VirtualClock
from drivers.recording import open_recording
from service.capture.configured import make_rig
from service.config.file import load
from service.daemon.run import run_service
from service.jobs.export import fused_maps
from solver import FusionOptions, fuse, methods

Write = Callable[[str, str], str]

SETTINGS = {"integration_time": 1e-3}
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Puts the page's example of a kind where Python finds it; returns the module's name."""

    def written(kind: str, module: str) -> str:
        (code,) = re.findall(rf"```python {kind}\n(.*?)```", PAGE, flags=re.S)
        (tmp_path / f"{module}.py").write_text(code)
        monkeypatch.syspath_prepend(tmp_path)
        return module

    return written


def test_a_newcomer_adds_a_camera_a_stage_and_a_sink(write: Write, tmp_path: Path, endpoint: str) -> None:
    """In a package of their own."""
    written = [write("camera", "wall_camera"), write("stage", "model_stage"), write("sink", "depth_log")]
    (package,) = re.findall(r"```toml package\n(.*?)```", PAGE, flags=re.S)
    told = tomllib.loads(package)
    assert told["tool"]["setuptools"]["py-modules"] == written
    installed = tmp_path / "my_rig-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my-rig\nVersion: 1.0\n")
    groups = told["project"]["entry-points"]
    names = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in groups[group].items()) for group in groups]
    (installed / "entry_points.txt").write_text("\n".join(names))
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    sink = {"kind": "depth-log", "options": {"path": str(tmp_path / "depths")}}
    settings = load(
        None,
        {
            "camera": {
                "backend": "wall",
                "options": {"distance": 3.0},
                "settings": {"integration_time": 1e-3},
            },
            "stage": {"backend": "model", "options": {"speed": 300.0, "acceleration": 3600.0}, "settle": 0.0},
            "fusion": {"method": "nearest", "frames": 3, "register_poses": False},
            "zenoh": {"config": str(zenoh)},
            "sinks": {"depths": sink},
        },
    )
    run_service(settings, make_rig(settings), output=tmp_path / "out", once=True)
    assert float((tmp_path / "depths").read_text()) == pytest.approx(3.0, abs=0.01)
    (found,) = fused_maps(open_recording(tmp_path / "out" / "fused.mcap"))
    middle = found["depth"][288, 352]
    assert middle == pytest.approx(3.0, abs=0.01)


def test_the_stage_is_where_it_was_sent(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(backends.CAMERAS, "wall", (write("camera", "wall_camera"), "WallCamera"))
    monkeypatch.setitem(backends.STAGES, "model", (write("stage", "model_stage"), "ModelStage"))
    clock = VirtualClock(1_700_000_000 * 10**9)
    with make_stage("model", clock=clock) as stage, make_camera("wall", {"distance": 3.0}, clock) as camera:
        stage.move_to(0.2, -0.1)
        stage.wait()
        assert (stage.position.pan, stage.position.tilt) == (0.2, -0.1)
        camera.start()
        first, second = camera.grab(), camera.grab()
        assert second.sequence == first.sequence + 1
        matrix = np.linalg.inv(camera.calibration.intrinsics.matrix)
        rows, columns = np.indices(first.shape)
        rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ matrix.T
        np.testing.assert_allclose(first.distance / np.linalg.norm(rays, axis=-1), 3.0, atol=1e-3)


def test_a_newcomer_adds_a_method(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(methods.METHODS, "average", write("method", "average"))
    frames = np.stack([np.full((8, 8), 2.0), np.full((8, 8), 2.2)])
    options = FusionOptions(method="average", upsampling=2)  # type: ignore[arg-type]
    fused = fuse(frames, options=options, shifts=np.zeros((2, 2)))
    np.testing.assert_allclose(fused.distance, 2.1, atol=1e-6)
    assert fused.report.method == "average"


@pytest.mark.parametrize("change", [("distance, None,", "distance[:2], None,"), ("np.float32", "np.float64")])
def test_a_method_that_gives_no_map_of_the_fused_size_is_told(
    change: tuple[str, str], write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wrong.py").write_text(
        (tmp_path / f"{write('method', 'right')}.py").read_text().replace(*change)
    )
    monkeypatch.setitem(methods.METHODS, "wrong", "wrong")
    monkeypatch.delitem(sys.modules, "wrong", raising=False)
    options = FusionOptions(method="wrong", upsampling=2)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"method 'wrong' gave a distance of shape .* \(16, 16\), float32"):
        fuse(np.full((2, 8, 8), 2.0), options=options, shifts=np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (("wall_camera", "WalCamera"), "camera backend 'wall' cannot be loaded: .*'WalCamera'"),
        (("wall_kamera", "WallCamera"), "camera backend 'wall' cannot be loaded: .*'wall_kamera'"),
    ],
)
def test_a_camera_that_is_not_there_is_told(
    place: tuple[str, str], message: str, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    write("camera", "wall_camera")
    monkeypatch.setitem(backends.CAMERAS, "wall", place)
    with pytest.raises(NotAvailableError, match=message):
        make_camera("wall")


def test_what_is_no_frame_is_told(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    right = tmp_path / f"{write('camera', 'wall_camera')}.py"
    (tmp_path / "empty_camera.py").write_text(right.read_text().replace("return Frame(", "Frame("))
    monkeypatch.setitem(backends.CAMERAS, "wall", ("empty_camera", "WallCamera"))
    clock = VirtualClock(1_700_000_000 * 10**9)
    with make_camera("wall", clock=clock) as camera:
        camera.start()
        with pytest.raises(TypeError, match=r"WallCamera\._grab gave None; expected a Frame"):
            camera.grab()


@pytest.mark.slow
def test_a_newcomer_adds_a_topic(tmp_path: Path, endpoint: str) -> None:
    """In a copy of the packages."""
    git = shutil.which("git")
    if git is None:
        pytest.skip("needs git, to apply the page's change")
    for package in ("service", "drivers", "solver"):
        shutil.copytree(ROOT / package, tmp_path / package, symlinks=True)
    shutil.copy(ROOT / "lidarboost.py", tmp_path)
    (change,) = re.findall(r"```diff\n(.*?)```", PAGE, flags=re.S)
    subprocess.run([git, "apply", "--recount", "-"], cwd=tmp_path, input=change, text=True, check=True)
    (tmp_path / "zenoh.json5").write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    (tmp_path / "rig.toml").write_text('[zenoh]\nconfig = "zenoh.json5"\n[fusion]\nmethod = "nearest"\n')
    recording = ROOT / "recordings" / "wedges.mcap"
    command = [sys.executable, "-m", "lidarboost", "run", "rig.toml", "--replay", str(recording), "--once"]
    command += ["--output", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "fused.mcap").open("rb") as file:
        (found,) = [m for _, _, m in make_reader(file).iter_messages(topics=["/fused/median"])]
    assert 2.0 < json.loads(found.data)["metres"] < 3.5
