"""What a process may find around it: narrow encodings, closed streams, signals, foreign variables."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scripted import SHAPE, calibration, frame

from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording

ROOT = Path(__file__).parents[2]
RUN = [sys.executable, "-c", "from service.entry import main; main()"]


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two bursts of four tiny frames."""
    path = tmp_path / "small.mcap"
    with RecordingWriter(path) as writer:
        writer.write_calibration(calibration(), 0)
        for k in range(8):
            writer.write_frame(frame(k, 10**18 + k * 10**8, burst=k // 4, pose=k % 4), Mount())
    return path


@pytest.fixture
def environment(tmp_path: Path, endpoint: str) -> dict[str, str]:
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    ours = {name: value for name, value in os.environ.items() if not name.startswith("LIDARBOOST_")}
    return ours | {
        "LIDARBOOST_ZENOH__CONFIG": str(zenoh),
        "LIDARBOOST_FUSION__METHOD": "nearest",
        "LIDARBOOST_FUSION__REGISTER_POSES": "false",
    }


def lidarboost(
    *words: object, env: dict[str, str], shell: str = "", limit: int | None = None, timeout: float = 90
) -> "subprocess.CompletedProcess[bytes]":
    """Run it; `shell` says what a shell does to its streams, `limit` how many blocks a file may have."""
    command = [*RUN, *(os.fsencode(str(word)) for word in words)]
    script = f'{"" if limit is None else f"ulimit -f {limit}; "}exec "$@" {shell}'
    return subprocess.run(
        ["sh", "-c", script, "sh", *command],
        cwd=ROOT,
        env=env,
        capture_output=True,
        timeout=timeout,
        check=False,
    )


NARROW = [
    ["info", "recordings/wedges.mcap"],
    ["config", "schema"],
    ["doctor"],
    ["devices"],
    ["fuse", "--help"],
    ["--help"],
]


@pytest.mark.parametrize("encoding", ["latin-1", pytest.param("ascii", marks=pytest.mark.faults)])
def test_what_an_encoding_lacks_is_replaced_and_undoes_nothing(
    small: Path, tmp_path: Path, environment: dict[str, str], encoding: str
) -> None:
    environment["PYTHONIOENCODING"] = encoding
    done = lidarboost("fuse", small, "-o", tmp_path / "x.mcap", env=environment)
    assert done.returncode == 0, done.stderr
    assert open_recording(tmp_path / "x.mcap").topics["fused/depth"].count == 2
    for words in NARROW:
        done = lidarboost(*words, env=environment)
        assert b"error" not in done.stderr, (words, done.stderr)
        assert done.stdout


@pytest.mark.faults
def test_a_name_that_is_no_text_is_no_obstacle(
    small: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    name = Path(os.fsdecode(os.fsencode(tmp_path) + b"/odd-\xff.mcap"))
    small.rename(name)
    done = lidarboost("info", name, env=environment)
    assert done.returncode == 0, done.stderr
    assert b"8 of 6" in done.stdout
    done = lidarboost("info", name, "--json", env=environment)
    assert json.loads(done.stdout)["path"].endswith("odd-\N{REPLACEMENT CHARACTER}.mcap"), done.stderr
    done = lidarboost("fuse", name, "-o", tmp_path / "x.mcap", "--json", env=environment)
    assert done.returncode == 0, done.stderr
    done = lidarboost(
        "run", "--replay", name, "--once", "--output", tmp_path / "out", "--json", env=environment
    )
    assert (done.returncode, json.loads(done.stdout)["lost"]) == (0, []), done.stderr


@pytest.mark.parametrize(
    "closed", ["<&- >&- 2>&-", *(pytest.param(one, marks=pytest.mark.faults) for one in ("2>&-", ">&-"))]
)
def test_closed_streams_are_no_obstacle(
    small: Path, tmp_path: Path, environment: dict[str, str], closed: str
) -> None:
    done = lidarboost("fuse", small, "-o", tmp_path / "x.mcap", env=environment, shell=closed)
    assert done.returncode == 0, done.stderr
    whole = open_recording(tmp_path / "x.mcap")
    assert whole.damage is None
    out = tmp_path / "out"
    done = lidarboost("run", "--replay", small, "--once", "--output", out, env=environment, shell=closed)
    assert done.returncode == 0, done.stderr
    assert open_recording(out / "fused.mcap").damage is None


def test_a_full_standard_output_is_said_but_one_without_a_reader_is_not(
    small: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    done = lidarboost("config", "schema", env=environment, shell=">/dev/full")
    assert (done.returncode, done.stderr) == (1, b"error: standard output: No space left on device\n")
    done = lidarboost("fuse", small, "-o", tmp_path / "x.mcap", env=environment, shell="| :")
    assert (done.returncode, done.stderr) == (0, b"")
    assert open_recording(tmp_path / "x.mcap").damage is None


KUBERNETES = {
    "LIDARBOOST_PORT": "tcp://10.0.0.7:7447",
    "LIDARBOOST_PORT_7447_TCP": "tcp://10.0.0.7:7447",
    "LIDARBOOST_PORT_7447_TCP_ADDR": "10.0.0.7",
    "LIDARBOOST_PORT_7447_TCP_PORT": "7447",
    "LIDARBOOST_PORT_7447_TCP_PROTO": "tcp",
    "LIDARBOOST_SERVICE_HOST": "10.0.0.7",
    "LIDARBOOST_SERVICE_PORT": "7447",
    "LIDARBOOST_SERVICE_PORT_ZENOH": "7447",
    "LIDARBOOST_ZENOH_SERVICE_HOST": "10.0.0.8",
    "LIDARBOOST_ZENOH_PORT": "tcp://10.0.0.8:7447",
}


@pytest.mark.parametrize("command", ["fuse", "simulate", "import"])
def test_a_result_that_found_no_room_leaves_nothing_and_replaces_nothing(
    command: str, small: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    images = tmp_path / "images"
    images.mkdir()
    for number in range(8):
        np.save(images / f"{number}.npy", np.random.default_rng(number).uniform(1, 2, SHAPE))
    optics = tmp_path / "camera.toml"
    calibration().save(optics)
    told: dict[str, list[object]] = {
        "fuse": [small],
        "simulate": ["-n", 1],
        "import": [images, "--calibration", optics, "--kind", "distance", "--rate", 5, "--scale", 1],
    }
    before = tmp_path / "before.mcap"
    before.write_bytes(b"made before")
    words = [command, *told[command], "-o", before, "--force"]
    found = lidarboost(*words, env=environment, limit=4)
    assert (found.returncode, b"cannot be written: File too large" in found.stderr) == (1, True), found.stderr
    assert before.read_bytes() == b"made before"
    assert not list(tmp_path.glob("before*.active"))


def test_variables_that_kubernetes_makes_are_none_of_ours(environment: dict[str, str]) -> None:
    done = lidarboost("config", "check", env=environment | KUBERNETES)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGHUP,
        *(pytest.param(one, marks=pytest.mark.faults) for one in (signal.SIGTERM, signal.SIGINT)),
    ],
)
def test_a_signal_leaves_nothing_behind(
    tmp_path: Path, environment: dict[str, str], number: signal.Signals
) -> None:
    words = ["simulate", "-n", "200", "--output", str(tmp_path / "out" / "scan.mcap")]
    (tmp_path / "out").mkdir()
    child = subprocess.Popen([*RUN, *words], cwd=ROOT, env=environment, stderr=subprocess.PIPE)
    active = tmp_path / "out" / "scan.mcap.active"
    until(lambda: active.exists() and active.stat().st_size > 100_000, child)
    child.send_signal(number)
    _, said = child.communicate(timeout=30)
    assert child.returncode == 130
    assert said.endswith(b"error: interrupted\n")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.faults
def test_what_ignores_a_closed_shell_goes_on(tmp_path: Path, environment: dict[str, str]) -> None:
    words = ["simulate", "-n", "20", "--output", str(tmp_path / "scan.mcap")]
    child = subprocess.Popen(
        ["nohup", *RUN, *words], cwd=ROOT, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    )
    active = tmp_path / "scan.mcap.active"
    until(lambda: active.exists() and active.stat().st_size > 100_000, child)
    child.send_signal(signal.SIGHUP)
    child.communicate(timeout=90)
    assert child.returncode == 0
    assert open_recording(tmp_path / "scan.mcap").frame_count == 20


def test_capture_that_is_ended_early_keeps_what_it_took(
    tmp_path: Path, small: Path, environment: dict[str, str]
) -> None:
    environment |= {
        "LIDARBOOST_CAMERA__BACKEND": "replay",
        "LIDARBOOST_CAMERA__OPTIONS__PATH": str(small),
        "LIDARBOOST_CAMERA__OPTIONS__LOOP": "true",
        "LIDARBOOST_CAMERA__OPTIONS__SPEED": "2",
    }
    look = tmp_path / "look.mcap"
    child = subprocess.Popen(
        [*RUN, "capture", "-n", "1000", "-o", str(look)], cwd=ROOT, env=environment, stdout=subprocess.PIPE
    )
    until(look.with_name("look.mcap.active").exists, child)
    time.sleep(1.0)
    child.send_signal(signal.SIGINT)
    said, _ = child.communicate(timeout=60)
    kept = open_recording(look)
    assert child.returncode == 0
    assert kept.damage is None
    assert 1 <= kept.frame_count < 1000
    assert f"{kept.frame_count} frames of".encode() in said
    assert look.with_suffix(".png").exists()


@pytest.mark.faults
@pytest.mark.parametrize("words", [["run", "--replay", "{}", "--loop"], ["fuse", "{}"], ["run", "--once"]])
def test_a_signal_in_the_first_second_leaves_no_traceback(
    small: Path, environment: dict[str, str], words: list[str]
) -> None:
    for delay in (0.1, 0.3, 0.6, 1.0):
        command = [*RUN, *(word.format(small) for word in words)]
        child = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        until(partial(begun, child.pid), child)
        time.sleep(delay)
        child.send_signal(signal.SIGINT)
        said, _ = child.communicate(timeout=60)
        assert b"Traceback" not in said, said
        # In its very last moment, when all is done, the interpreter takes no signals any more.
        ended = (0,) if words[-1] == "--loop" else (0, 1, 130, -signal.SIGINT)
        assert child.returncode in ended, said


def begun(pid: int) -> bool:
    """Whether the process notes signals: it catches SIGTERM."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    caught = int(next(line for line in status.splitlines() if line.startswith("SigCgt")).split()[1], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def until(happened, child: "subprocess.Popen[bytes]") -> None:
    deadline = time.monotonic() + 60
    while not happened():
        assert child.poll() is None, "it ended"
        assert time.monotonic() < deadline
        time.sleep(0.01)
