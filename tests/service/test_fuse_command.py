"""`lidarboost fuse` as it is typed: the same maps each time, and one bad input among others."""

import json
from pathlib import Path

import numpy as np
import pytest
from scripted import frame
from typed import lidarboost, write

from drivers.recording import open_recording

pytestmark = pytest.mark.usefixtures("typing_settings")


def test_fuse_writes_the_same_maps_each_time(small: Path, tmp_path: Path) -> None:
    result = lidarboost("fuse", small, "--output", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    (found,) = json.loads(result.stdout)
    assert [b["report"]["burst"] for b in found["bursts"]] == [0, 1, 2]
    fused = Path(found["output"])
    stem = fused.name.removesuffix("-fused.mcap")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [f"{stem}-burst-000{k}.png" for k in range(3)] + [fused.name]
    assert lidarboost("fuse", small, "-o", tmp_path / "again.mcap").exit_code == 0
    first, again = (
        [(m.topic, m.payload, at) for m, at in open_recording(path).messages() if m.topic != "fused/report"]
        for path in (fused, tmp_path / "again.mcap")
    )
    assert first == again


def test_fuse_goes_on_with_the_next_input_and_fails_in_the_end(small: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_text("not a recording at all")
    result = lidarboost("fuse", bad, small)
    assert result.exit_code == 1
    assert "small.mcap: burst 2" in result.stdout
    assert result.stderr.startswith("error: ")


def test_a_burst_that_cannot_be_fused_is_passed_over_and_told(tmp_path: Path) -> None:
    frames = [frame(k, 10**18 + k * 10**8, burst=k // 2, pose=k % 2) for k in range(6)]
    dark = [frame(k, 10**18 + k * 10**8, counts=np.zeros_like(frames[0].counts), burst=1) for k in (2, 3)]
    path = write(tmp_path / "scan.mcap", frames[:2] + dark + frames[4:])
    for resumed in (False, True):
        result = lidarboost("fuse", path, "--output", tmp_path / "out", "--json")
        assert (result.exit_code, result.stderr.count("burst 1 not fused: ")) == (3, 1)
        (found,) = json.loads(result.stdout)
        assert [b["report"]["burst"] for b in found["bursts"]] == [0, 2]
        assert (found["resumed"], found["error"], len(found["failures"])) == (resumed, None, 1)
    assert len(list(open_recording(Path(found["output"])).messages(["fused/depth"]))) == 2
    alone = write(tmp_path / "dark.mcap", dark)
    result = lidarboost("fuse", alone, "-o", tmp_path / "x.mcap")
    assert (result.exit_code, (tmp_path / "x.mcap").exists()) == (1, False)
    assert result.stderr.startswith(f"error: {alone}: no burst could be fused: burst 1 not fused: ")
