"""`lidarboost run` on the bundled recording, seen from outside: subscribers in processes of their own."""

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from service.messages.viewing import ON_DEMAND
from solver import FusionOptions, fuse
from solver.geometry.points import depth_from_distance

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "recordings" / "wedges.mcap"
LISTENER = ROOT / "tests" / "service" / "listener.py"
PREFIX = "test/bench"
FAST = 'method = "nearest"\nregister_poses = false\n'

MOST_ERROR = 0.025
"""Metres, mean absolute error of the fused depth."""


@dataclass(frozen=True)
class Pass:
    """One pass over the recording: how it ended, what a subscriber told, what was recorded."""

    process: "subprocess.CompletedProcess[str]"
    told: dict[str, dict[str, Any]]
    recorded: dict[str, list[bytes]]


@contextmanager
def started(*arguments: str) -> Iterator["subprocess.Popen[str]"]:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, *arguments], cwd=ROOT, text=True, **pipes) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.kill()


def configured(directory: Path, fusion: str = "") -> tuple[str, Path]:
    """A free endpoint, and a configuration whose service listens on it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    (directory / "zenoh.json5").write_text(f'{{ listen: {{ endpoints: ["{endpoint}"] }} }}')
    config = directory / "rig.toml"
    config.write_text(
        f'[zenoh]\nconfig = "{directory / "zenoh.json5"}"\nprefix = "{PREFIX}"\n[fusion]\n{fusion}'
    )
    return endpoint, config


def told_by(process: "subprocess.Popen[str]") -> dict[str, dict[str, Any]]:
    out, err = process.communicate(timeout=170)
    assert err == ""
    rows = [json.loads(line) for line in out.splitlines()]
    return {row["key"].removeprefix(PREFIX + "/"): row for row in rows}


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Pass:
    directory = tmp_path_factory.mktemp("once")
    endpoint, config = configured(directory)
    output = directory / "out"
    command = [
        "-m",
        "lidarboost",
        "run",
        str(config),
        "--replay",
        str(RECORDING),
        "--once",
        "--output",
        str(output),
    ]
    with started(str(LISTENER), endpoint, PREFIX, "1000", "--until", "fused/report") as listener:
        process = subprocess.run(
            [sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=150
        )
        assert process.returncode == 0, process.stderr
        told = told_by(listener)
    recorded: dict[str, list[bytes]] = {}
    with (output / "fused.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            recorded.setdefault(channel.topic.removeprefix("/"), []).append(message.data)
    return Pass(process, told, recorded)


def test_a_subscriber_receives_what_is_recorded_byte_for_byte(once: Pass) -> None:
    maps = {topic for topic in once.recorded if topic.startswith("fused/")}
    assert {"fused/depth", "fused/deviation", "fused/calibration", "fused/report"} <= maps
    for topic in maps:
        assert len(once.recorded[topic]) == 1
    for topic in maps - set(ON_DEMAND):  # those may come after the report, with which the listener ends
        assert once.told[topic]["sha256"] == hashlib.sha256(once.recorded[topic][0]).hexdigest()


def test_the_subscriber_decodes_a_map_that_fits_its_recording(once: Pass) -> None:
    frames = list(open_recording(RECORDING).frames())
    depth, calibration, report = (
        once.told[topic] for topic in ("fused/depth", "fused/calibration", "fused/report")
    )
    assert depth["shape"] == calibration["shape"] == [576, 704]
    assert depth["frame_id"] == calibration["frame_id"] == "fused"
    assert {depth["timestamp"], calibration["timestamp"]} == {frames[0].timestamp}
    assert calibration["K"] == pytest.approx([800, 0, 351.5, 0, 800, 287.5, 0, 0, 1])
    assert report["json"]["frames"] == 15
    assert report["json"]["sequence"] == [frame.sequence for frame in frames]
    assert report["json"]["missing"] == 0


def test_the_map_is_near_the_truth_and_better_than_nearest(once: Pass) -> None:
    image = RawImage.FromString(once.recorded["fused/depth"][0])
    depth = np.frombuffer(image.data, "<f4").reshape(image.height, image.width)
    K = np.array(CameraCalibration.FromString(once.recorded["fused/calibration"][0]).K).reshape(3, 3)
    recording = open_recording(RECORDING)
    assert recording.truth is not None
    truth = depth_from_distance(recording.truth, K)
    nearest = depth_from_distance(_nearest(RECORDING), K)
    seen = np.isfinite(truth) & np.isfinite(depth) & np.isfinite(nearest)
    assert seen.mean() > 0.95
    error, usual = (float(np.abs(image - truth)[seen].mean()) for image in (depth, nearest))
    assert error < MOST_ERROR
    assert error < 0.5 * usual


def _nearest(path: Path) -> np.ndarray:
    recording = open_recording(path)
    frames, calibration = list(recording.frames()), recording.calibration
    turns = relative_rotations([(frame.pan, frame.tilt) for frame in frames], calibration.mount)
    options = FusionOptions(method="nearest", upsampling=4)
    return fuse(
        np.stack([frame.distance for frame in frames]),
        options=options,
        rotations=turns,
        intrinsics=calibration.intrinsics.matrix,
    ).distance


def test_the_recorded_output_holds_the_frames_that_went_in(once: Pass) -> None:
    with RECORDING.open("rb") as stream:
        sent = [
            (channel.topic.removeprefix("/"), message.data)
            for _, channel, message in make_reader(stream).iter_messages(
                topics=["/camera/distance", "/camera/amplitude"], log_time_order=False
            )
        ]
    for topic in ("camera/distance", "camera/amplitude"):
        assert once.recorded[topic] == [data for name, data in sent if name == topic]


def test_late_subscribers_and_queries_receive_the_latest_and_a_signal_ends_it_cleanly(tmp_path: Path) -> None:
    endpoint, config = configured(tmp_path, FAST)
    command = ["-m", "lidarboost", "run", str(config), "--replay", str(RECORDING), "--speed", "50", "--loop"]
    with started(*command) as service:
        with started(str(LISTENER), endpoint, PREFIX, "1", "--get", "fused/report") as query:
            report = told_by(query)["fused/report"]["json"]
        assert report["frames"] == 15
        with started(str(LISTENER), endpoint, f"{PREFIX}/fused/depth", "1", "--advanced") as late:
            assert told_by(late)["fused/depth"]["shape"] == [576, 704]
        for _ in range(20):  # it is told once a second: the latest may be of before the first map
            with started(str(LISTENER), endpoint, PREFIX, "1", "--get", "status") as query:
                status = told_by(query)["status"]["json"]
            if status["totals"]["fused"]:
                break
        assert status["source"] == "replay"
        assert status["totals"]["fused"] >= 1
        service.send_signal(signal.SIGTERM)
        _, err = service.communicate(timeout=60)
        assert service.returncode == 0, err
        assert "Traceback" not in err


def test_a_port_in_use_ends_it_with_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    endpoint, config = configured(tmp_path)
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", int(endpoint.rpartition(":")[2])))
        taken.listen()
        command = [
            "run",
            str(config),
            "--replay",
            str(RECORDING),
            "--once",
            "--output",
            str(tmp_path / "out"),
        ]
        process = subprocess.run(
            [sys.executable, "-m", "lidarboost", *command],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert process.returncode == 1
    errors = [line for line in process.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert f"{endpoint} is in use by process {os.getpid()}" in errors[0]
    assert not (tmp_path / "out").exists()
