"""A service that goes on through faults of devices, worker, disk, configuration, and beside another one."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rig_process import COMMON, PLUGGED, ROOT, SIMULATED, RigProcess, free_endpoint, rig_process

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from emulators.ptu_emulator import PtuEmulator

from drivers.recording import Recording

pytestmark = pytest.mark.faults

ON_A_STAGE = """
[camera]
backend = "simulated"
options = {{ scene = "plane" }}
[stage]
backend = "ptu"
options = {{ port = "{port}" }}
"""


def maps_come(rig: RigProcess, seconds: float = 60.0) -> dict[str, Any]:
    """The status, once two more maps have come and all is well."""
    before = rig.wait(lambda _: True, seconds)["totals"]["fused"]
    return rig.wait(
        lambda told: (
            told["totals"]["fused"] >= before + 2 and told["state"] == "scanning" and not told["degraded"]
        ),
        seconds,
    )


@pytest.mark.parametrize(("broken", "mended"), [("unplug", "replug"), ("silence", "talk")])
def test_a_camera_that_is_away_is_told_waited_for_and_taken_up_again(
    tmp_path: Path, broken: str, mended: str
) -> None:
    with rig_process(tmp_path, PLUGGED, "scan") as rig:
        maps_come(rig, 120)
        rig.tell_camera(broken)
        told = rig.wait_state("recovering")
        assert told["reason"]
        assert told["drops"]["bursts"] >= 1
        refused = rig.ask("cmd/settings", action="set", integration_time=0.01)
        assert refused["code"] == "UNAVAILABLE"
        rig.tell_camera(mended)
        told = maps_come(rig)
        assert told["error"] is None
        rig.end()


def test_a_worker_that_is_stopped_is_replaced_and_status_and_log_say_so(tmp_path: Path) -> None:
    with rig_process(tmp_path, PLUGGED, "scan") as rig:
        maps_come(rig, 120)
        os.kill(worker_of(rig), signal.SIGSTOP)
        told = rig.wait(lambda told: told["fusion"]["hung"] == 1, 150)
        assert told["fusion"]["restarts"] == 1
        maps_come(rig)
    assert "gave no answer within" in rig.log.read_text()


def worker_of(rig: RigProcess) -> int:
    threads = Path(f"/proc/{rig.process.pid}/task").iterdir()
    children = {int(one) for thread in threads for one in (thread / "children").read_text().split()}
    return min(  # the spare one is younger
        one for one in children if b"fusion.answering" in Path(f"/proc/{one}/cmdline").read_bytes()
    )


def test_the_configuration_is_reloaded_and_an_error_in_it_changes_nothing(tmp_path: Path) -> None:
    with rig_process(tmp_path, SIMULATED, "scan") as rig:
        maps_come(rig, 120)
        text = rig.config.read_text()
        rig.ask("cmd/fusion", action="set", method="bicubic")
        rig.wait(lambda told: told["in_force"]["method"] == "bicubic")
        rig.config.write_text(text.replace("frames = 5", "frames = 0"))
        rig.process.send_signal(signal.SIGHUP)
        told = rig.wait(lambda told: told["degraded"])
        assert "fusion.frames" in told["degraded"][0]["what"]
        assert told["in_force"]["method"] == "bicubic"
        changed = text.replace("frames = 5", "frames = 4").replace('start = "scan"', 'start = "idle"')
        rig.config.write_text(changed)
        rig.process.send_signal(signal.SIGHUP)
        told = rig.wait(lambda told: told["in_force"]["frames"] == 4)
        assert told["in_force"]["method"] == "nearest"
        told = maps_come(rig)
        rig.end()
    said = rig.log.read_text()
    assert "was not reloaded" in said
    assert "needs a restart: start" in said


def test_two_services_share_a_recording_folder(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    shared = COMMON.replace("{folder}/disk", str(tmp_path))
    with (
        rig_process(first, SIMULATED, "scan", shared) as one,
        rig_process(second, SIMULATED, "scan", shared) as two,
    ):
        for rig in (one, two):
            maps_come(rig, 120)
        for rig in (one, two):
            rig.end()
            assert "resumed" not in rig.log.read_text(), "it took up what the other one had begun"
    files = list((tmp_path / "recordings").iterdir())
    assert {path.suffix for path in files} == {".mcap"}
    assert len(files) >= 2
    assert {Recording(path).damage for path in files} == {None}


def test_a_second_service_on_the_same_stage_ends_with_one_line(tmp_path: Path) -> None:
    devices = ON_A_STAGE.format(port=tmp_path / "ptu")
    with PtuEmulator(tmp_path / "ptu"), rig_process(tmp_path, devices, "scan") as rig:
        maps_come(rig, 120)
        other = tmp_path / "other"
        other.mkdir()
        zenoh = other / "zenoh.json5"
        zenoh.write_text(json.dumps({"listen": {"endpoints": [free_endpoint()]}}))
        (other / "rig.toml").write_text(COMMON.format(folder=other, devices=devices, start="scan"))
        done = subprocess.run(
            [sys.executable, "-m", "lidarboost", "run", str(other / "rig.toml")],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 1
        [line] = [one for one in done.stderr.splitlines() if one.startswith("error:")]
        assert "another program uses the serial port" in line
        maps_come(rig)


def test_a_deleted_folder_is_told_and_recording_goes_on(tmp_path: Path) -> None:
    with rig_process(tmp_path, SIMULATED, "scan") as rig:
        maps_come(rig, 120)
        shutil.rmtree(tmp_path / "disk")
        told = rig.wait(lambda told: told["recorder"]["lost"] > 0)
        time.sleep(1.0)
        told = maps_come(rig)
        assert told["recorder"]["recording"]
        rig.end()
    assert "lost:" in rig.log.read_text()
    assert "is gone" in rig.log.read_text()
