"""The kernels' cache on disk matters to nothing but the time taken, and runs nobody else's code."""

import errno
import grp
import hashlib
import importlib.util
import logging
import os
import pickle
import resource
import subprocess
import sys
import tempfile
import types
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from numba.core import config

from solver.runtime import caching, files

ROOT = Path(caching.__file__).parents[2]

KERNEL = "from numba import njit\n\n@njit(cache=True)\ndef kernel(x):\n    return 2 * x + 1\n"


class Machine:
    """A module with a kernel, imported anew for every call as by a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.cache = folder / "cache"
        self._source = folder / "made.py"
        self._source.write_text(KERNEL)

    def call(self, x: float = 10) -> tuple[float, int]:
        """The kernel's value, and how many compiled kernels came from the disk."""
        files.fault_in_writing.cache_clear()
        files._is_own.cache_clear()
        spec = importlib.util.spec_from_file_location("solver.made", self._source)
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules["solver.made"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        value = module.kernel(x)
        return value, sum(module.kernel.stats.cache_hits.values())

    def files(self, suffix: str) -> list[Path]:
        return sorted(self.cache.rglob(f"made.kernel-*{suffix}"))

    @property
    def folder(self) -> Path:
        return self.files(".nbi")[0].parent


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    made = Machine(tmp_path)
    monkeypatch.setattr(config, "CACHE_DIR", str(made.cache))
    monkeypatch.setattr(caching, "_has_warned", False)
    monkeypatch.setattr(caching, "_caches", [])
    yield made
    sys.modules.pop("solver.made", None)
    caching.digest.cache_clear()
    files.fault_in_writing.cache_clear()
    files._is_own.cache_clear()


def _truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-5])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def _replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _replace_by_link(path: Path) -> None:
    path.rename(path.with_suffix(".moved"))
    path.symlink_to(path.with_suffix(".moved"))


DAMAGES: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "torn": _truncate,
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "garbage": lambda path: path.write_bytes(b"\x80\x05garbage" * 50),
    "a bit": _flip,
    "something else": lambda path: path.write_bytes(pickle.dumps(("0.1", {"a": 1}))),
    "gone": lambda path: path.unlink(),
    "a link": _replace_by_link,
}


def told(caplog: pytest.LogCaptureFixture) -> list[logging.LogRecord]:
    """What a user is told: warnings, whatever level other tests have set."""
    return [record for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_what_cannot_be_read_is_compiled_anew_and_kept_again(
    machine: Machine, suffix: str, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert machine.call() == (21, 0)
    assert machine.call() == (21, 1)
    DAMAGES[damage](machine.files(suffix)[0])
    assert machine.call() == (21, 0)
    assert machine.call() == (21, 1)
    assert not told(caplog)


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_a_file_that_cannot_even_be_replaced_is_told_once(
    machine: Machine, suffix: str, caplog: pytest.LogCaptureFixture
) -> None:
    machine.call()
    _replace_by_folder(machine.files(suffix)[0])
    assert machine.call() == (21, 0)
    assert machine.call() == (21, 0)
    (record,) = told(caplog)
    assert record.getMessage() == (
        f"compiled kernels cannot be kept ({machine.folder}: Is a directory): every start compiles them "
        "anew, which takes minutes; name a folder of your own in NUMBA_CACHE_DIR"
    )


def test_an_overload_in_the_place_of_another_is_not_taken_for_it(machine: Machine) -> None:
    """As two processes may leave them, and as an old kernel lies beside a new index."""
    machine.call(10)
    whole = machine.files(".nbc")[0]
    machine.call(0.5)
    other = next(path for path in machine.files(".nbc") if path != whole)
    whole.write_bytes(other.read_bytes())
    assert machine.call(10) == (21, 0)
    assert machine.call(0.5) == (2, 1)


PROCESS = """
import sys
from importlib import util
import solver.kernels
spec = util.spec_from_file_location("solver.made", "made.py")
made = sys.modules["solver.made"] = util.module_from_spec(spec)
spec.loader.exec_module(made)
print(made.kernel(float(sys.argv[1]) if "." in sys.argv[1] else int(sys.argv[1])))
"""


def test_two_processes_may_compile_at_once(machine: Machine, tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(machine.cache), "PYTHONPATH": str(ROOT)}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", PROCESS, x],
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=tmp_path,
        )
        for x in ("10", "10", "0.5", "0.5")
    ]
    assert [process.communicate()[0].strip() for process in running] == ["21", "21", "2.0", "2.0"]
    # Of two indices written at once one may be lost: that kernel is compiled once more.
    assert [machine.call(x)[0] for x in (10, 0.5)] == [21, 2]
    assert [machine.call(x)[1] for x in (10, 0.5)] == [1, 1]
    assert not list(machine.cache.rglob("*.tmp.*"))


class _Bomb:
    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.mark,)


def _plant(machine: Machine, mark: Path) -> None:
    """Code that runs when the index is unpickled."""
    data = pickle.dumps(_Bomb(mark))
    machine.files(".nbi")[0].write_bytes(hashlib.sha256(data).digest() + data)


def _give_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make it another user's; who may not, becomes another user himself."""
    if os.geteuid() == 0:
        os.chown(path, 54321, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 54321)


@pytest.mark.parametrize("whose", ["own", "another's file", "another's folder", "open file", "open folder"])
def test_only_what_nobody_else_can_have_written_is_unpickled(
    machine: Machine, tmp_path: Path, whose: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine.call()
    _plant(machine, tmp_path / "ran")
    index, folder = machine.files(".nbi")[0], machine.folder
    match whose:
        case "another's file":
            _give_away(index, monkeypatch)
        case "another's folder":
            _give_away(folder, monkeypatch)
        case "open file":
            index.chmod(0o646)
        case "open folder":
            folder.chmod(0o757)
    assert machine.call() == (21, 0)
    assert (tmp_path / "ran").exists() == (whose == "own")


@pytest.mark.parametrize(("name", "members", "hits"), [(None, [], 1), (None, ["eve"], 0), ("staff", [], 0)])
def test_a_group_may_write_where_the_user_is_alone_in_it(
    machine: Machine,
    monkeypatch: pytest.MonkeyPatch,
    name: str | None,
    members: list[str],
    hits: int,
) -> None:
    import pwd

    machine.call()
    machine.folder.chmod(0o775)
    found = types.SimpleNamespace(gr_name=name or pwd.getpwuid(os.geteuid()).pw_name, gr_mem=members)
    monkeypatch.setattr(grp, "getgrgid", lambda _: found)
    assert machine.call() == (21, hits)


@pytest.fixture
def frozen(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From its call on no file can be made."""

    def refuse(*_: object, **__: object) -> object:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    return lambda: monkeypatch.setattr(tempfile, "TemporaryFile", refuse)


def test_kernels_in_a_folder_that_cannot_be_written_are_used(
    machine: Machine, frozen: Callable[[], None], caplog: pytest.LogCaptureFixture
) -> None:
    machine.call(10)
    frozen()
    assert machine.call(10) == (21, 1)
    assert not told(caplog)
    assert machine.call(0.5) == (2, 0)
    assert machine.call(1.5) == (4, 0)
    (record,) = told(caplog)
    assert f"{machine.folder}: Read-only file system" in record.getMessage()
    assert len(machine.files(".nbc")) == 1


def test_kernels_beside_their_source_are_used_by_a_user_who_cannot_write_there(
    machine: Machine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a container whose image brings them along; what he compiles goes to his own folder."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    beside, made = tmp_path / "__pycache__", tempfile.TemporaryFile
    assert machine.call(10) == (21, 0)
    assert list(beside.glob("made.kernel-*.nbi"))

    def refuse(**place: object) -> object:
        if place["dir"] == beside:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        return made(**place)  # type: ignore[call-overload]

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    assert machine.call(10) == (21, 1)
    assert machine.call(0.5) == (2, 0)
    assert machine.call(0.5) == (2, 1)
    assert list((tmp_path / "home").rglob("made.kernel-*.nbi"))


def test_without_a_home_kernels_are_compiled(
    machine: Machine,
    frozen: Callable[[], None],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for a user who is not in the list
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    frozen()
    assert machine.call() == (21, 0)
    assert "cannot be kept" in caplog.text
    assert not Path("~").exists()


def test_a_full_disk_is_told_once_and_leaves_nothing_behind(
    machine: Machine, caplog: pytest.LogCaptureFixture
) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        assert machine.call(10) == (21, 0)
        assert machine.call(0.5) == (2, 0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    (record,) = told(caplog)
    assert "File too large" in record.getMessage()
    assert not [path for path in machine.cache.rglob("*") if path.is_file()]
    assert machine.call(10) == (21, 0)
    assert machine.call(10) == (21, 1)


def test_a_folder_on_a_full_disk_is_known_to_be_of_no_use_before_anything_is_compiled(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        assert files.fault_in_writing(tmp_path) == f"{tmp_path}: File too large"
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        files.fault_in_writing.cache_clear()
    assert files.fault_in_writing(tmp_path) is None


@pytest.mark.skipif(not hasattr(config, "CACHE_LOCATOR_CLASSES"), reason="this Numba has no such variable")
def test_numbas_variables_hold(
    machine: Machine,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "InTreeCacheLocator")
    monkeypatch.setattr(config, "DEBUG_CACHE", 1)
    assert machine.call() == (21, 0)
    assert f"[cache] data saved to '{tmp_path / '__pycache__'}'" in capsys.readouterr().out
    assert list((tmp_path / "__pycache__").glob("made.kernel-*.nbi"))
    assert machine.call() == (21, 1)
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "NoSuchLocator")
    assert machine.call() == (21, 0)
    assert "Unknown cache locator class: 'NoSuchLocator'" in caplog.text
