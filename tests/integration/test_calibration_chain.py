"""From a camera of which nothing is known to a fused map, by the commands alone."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.calibration import Calibration, Corrections, CyclicTerm, Intrinsics, Mount, NoiseLaw
from drivers.recording import attachments, open_recording
from service.cli import app

pytestmark = pytest.mark.faults

WALLS = (1.0, 1.5, 2.0, 2.6, 3.2)
"""Metres from the stage's axes."""


def pattern() -> np.ndarray:
    rows, columns = np.mgrid[:144, :176]
    found = 0.008 * np.sin(columns / 28) * np.cos(rows / 40)
    found += 0.006 * np.random.default_rng(1).standard_normal(found.shape)
    return np.asarray(np.round(found - found.mean(), 4))


TRUE = Calibration(
    width=176,
    height=144,
    intrinsics=Intrinsics(fx=206.0, fy=205.0, cx=90.2, cy=69.1),
    distortion=(-0.22, 0.10, 0.001, -0.0015),
    corrections=Corrections(
        constant=0.12,
        cyclic=(CyclicTerm(amplitude=0.025, harmonic=4, phase=1.1),),
        per_pixel=tuple(map(tuple, pattern().tolist())),
    ),
    mount=Mount(rotation=(0.02, -0.015, 0.03), lever_arm=(0.03, -0.05, 0.08)),
    noise=NoiseLaw(coefficient=24.0),
    source="made up",
)


def run(*words: object) -> str:
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 0, done.output
    return done.stdout


class Rig:
    """A folder with a simulated camera that knows nominal optics alone."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.output = folder, folder / "calibration.toml"
        self.true = folder / "true.toml"
        TRUE.save(self.true)

    def simulate(self, name: str, *words: object) -> Path:
        path = self.folder / f"{name}.mcap"
        run("simulate", *words, "--camera", self.true, "--uncalibrated", "-o", path)
        return path

    def calibrate(self, part: str, *words: object) -> None:
        base = ("--base", self.output) if self.output.exists() else ()
        run("calibrate", part, *words, *base, "-o", self.output)

    def errors(self, recording: Path, calibration: Path | None) -> tuple[float, float]:
        """RMS and mean absolute error of the fused map, metres."""
        words: tuple[object, ...] = ()
        if calibration is not None:
            configuration = self.folder / f"{calibration.stem}.rig.toml"
            configuration.write_text(f'[camera]\ncalibration = "{calibration}"\n')
            words = ("--config", configuration)
        (said,) = json.loads(run("fuse", recording, "--json", *words))
        found = said["bursts"][0]["errors"]
        return found["rms"], found["mean_absolute"]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Calibrated by all four commands, one after the other."""
    rig = Rig(tmp_path_factory.mktemp("rig"))
    board = rig.simulate("board", "--scene", "board", "--views", 14)
    rig.calibrate("intrinsics", board, "--board", "9x6", "--square", 50)
    walls = [
        rig.simulate(f"wall-{away}", "--scene", "plane", "--away", away, "--span", 0, "-n", 6)
        for away in WALLS
    ]
    # From the projection centre, which is 80 mm before the stage's axes.
    given = [word for away in WALLS for word in ("--at", away - TRUE.mount.lever_arm[2])]
    rig.calibrate("distance", *walls, *given)
    rig.calibrate("noise", rig.simulate("still", "--scene", "objects", "--span", 0, "-n", 6))
    rig.calibrate("mount", rig.simulate("turned", "--scene", "board", "--span", 40, "-n", 12))
    return rig


@pytest.fixture(scope="module")
def found(rig: Rig) -> Calibration:
    return Calibration.load(rig.output)


def test_the_optics_are_found(found: Calibration) -> None:
    optics, true = found.intrinsics, TRUE.intrinsics
    assert (optics.fx, optics.fy) == pytest.approx((true.fx, true.fy), rel=0.01)
    assert (optics.cx, optics.cy) == pytest.approx((true.cx, true.cy), abs=2.0)
    # Together they say where a pixel looks; what one has too much another takes away.
    grid = np.array([[[x, y]] for x in (10.0, 88.0, 165.0) for y in (10.0, 72.0, 133.0)])
    seen = [
        cv2.undistortPoints(grid, c.intrinsics.matrix, np.array(c.distortion)).reshape(-1, 2)
        for c in (found, TRUE)
    ]
    away = seen[0] - seen[1]
    away -= away.mean(axis=0)  # a shift of all is a turn of the camera
    assert np.abs(away).max() * true.fx < 1.0


def test_the_distance_errors_are_found(found: Calibration) -> None:
    assert found.corrections.constant == pytest.approx(0.12, abs=0.003)
    (term,) = found.corrections.cyclic
    assert term.harmonic == 4
    assert term.amplitude == pytest.approx(0.025, abs=0.002)
    assert term.phase == pytest.approx(1.1, abs=0.08)
    assert np.std(np.array(found.corrections.per_pixel) - pattern()) < 0.005


def test_the_noise_is_found(found: Calibration) -> None:
    assert found.noise is not None
    assert found.noise.coefficient == pytest.approx(24.0, rel=0.05)


def test_the_mount_is_found(found: Calibration) -> None:
    assert found.mount.rotation == pytest.approx(TRUE.mount.rotation, abs=0.008)
    assert found.mount.lever_arm == pytest.approx(TRUE.mount.lever_arm, abs=0.008)


def test_the_map_is_nearly_as_good_as_with_the_true_calibration(rig: Rig) -> None:
    scan = rig.simulate("scan", "--scene", "wedges", "-n", 15, "--span", 15)
    recording = open_recording(scan)
    assert recording.calibration.source == "nominal SR3000 optics"
    stored = recording.attachment(attachments.TRUE_CALIBRATION)
    assert stored is not None
    assert Calibration.from_toml(stored.decode()) == TRUE
    best, mine, nominal = (rig.errors(scan, path) for path in (rig.true, rig.output, None))
    assert mine[0] < 1.05 * best[0]
    assert mine[1] < 1.15 * best[1]
    assert nominal[1] > 5 * best[1]  # what there was to be found


def test_each_draws_a_picture(rig: Rig) -> None:
    for part in ("intrinsics", "distance", "noise", "mount"):
        picture = cv2.imread(str(rig.output.with_suffix(f".{part}.png")))
        assert picture is not None
        assert picture.std() > 10
