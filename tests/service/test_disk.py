"""The room that recordings have: measured apart from everything else, and told in minutes."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from service.config.sections import RecordingSection
from service.daemon.disk import DiskWatch
from service.messages.status import RecorderState

MB = 1_000_000


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], DiskWatch]:
    """A disk of 100 GB with 30 GB free, which holds one recording of 2 MB."""
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "20260131T235959Z-000001.mcap").write_bytes(bytes(2 * MB))
    (folder / "foreign.mcap").write_bytes(bytes(5 * MB))
    usage = shutil._ntuple_diskusage(100_000 * MB, 70_000 * MB, 30_000 * MB)  # type: ignore[attr-defined]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    section = RecordingSection(directory=folder, budget=1024.0, rotate_size=100.0)
    now = [0.0]

    def passing() -> float:
        return now[0]

    def made() -> DiskWatch:
        watch = DiskWatch(section, passing)
        watch.now = now  # type: ignore[attr-defined]
        return watch

    return made


def recorder(file: str, size: int) -> RecorderState:
    return RecorderState(recording=True, file=file, size=size)


def test_minutes_left_follow_from_what_was_written_and_what_may_be(disk: Callable[[], DiskWatch]) -> None:
    watch = disk()
    assert watch.state(None) is None  # not looked at yet
    watch.look()
    idle = watch.state(None)
    assert idle is not None
    assert (idle.free, idle.total, idle.rate, idle.minutes) == (30_000 * MB, 100_000 * MB, None, None)
    for second, (file, size) in enumerate([("a", 10), ("a", 14), ("a", 18), ("b", 2), ("b", 6), ("b", 10)]):
        watch.now[0] = float(second)  # type: ignore[attr-defined]
        told = watch.state(recorder(file, size * MB))
    assert told is not None
    assert told.rate == pytest.approx((4 + 4 + 2 + 4 + 4) * MB / 5)
    assert told.minutes == pytest.approx(
        (1024 - 2) * MB / told.rate / 60
    )  # the budget is full before the disk
    after = watch.state(RecorderState(recording=False, file="b", size=10 * MB))
    assert after is not None
    assert after.rate is None


def test_a_disk_that_stops_answering_is_not_known_any_more(disk: Callable[[], DiskWatch]) -> None:
    watch = disk()
    watch.look()
    watch.now[0] = 9.0  # type: ignore[attr-defined]
    assert watch.state(None) is not None
    watch.now[0] = 11.0  # type: ignore[attr-defined]
    assert watch.state(None) is None


def test_a_folder_that_is_not_there_yet_is_judged_by_the_disk_it_will_be_on(tmp_path: Path) -> None:
    watch = DiskWatch(RecordingSection(directory=tmp_path / "a" / "b"))
    watch.look()
    told = watch.state(None)
    assert told is not None
    assert told.total > told.free > 0
