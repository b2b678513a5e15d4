"""`lidarboost fuse` as it is typed: the same maps each time, and one bad input among others."""

import json
from pathlib import Path

import pytest
from typed import lidarboost

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
