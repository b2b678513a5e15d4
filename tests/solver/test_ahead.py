"""What a fusion calls is compiled before, in other processes where that is possible."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from solver.runtime import ahead
from solver.runtime.ahead import TABLE, Listed, compile_ahead, table

ROOT = Path(__file__).parents[2]

SMALL = "solver.kernels.filling.take", "solver.kernels.filling.divide", "solver.kernels.differences.light"
SMALL += "solver.kernels.rotation.rotation_matrices", "solver.kernels.rotation.rotation_vectors"

COMPILE = """
import json, sys
from numba.core import event
from solver.runtime import ahead
{before}
kernels = [kernel for kernel in ahead.table() if kernel.name in {names}]
ahead.table = lambda: tuple(kernels)
here, told = [], []
class Listener(event.Listener):
    def on_start(self, e): here.append(e.data["dispatcher"].py_func.__name__)
    def on_end(self, e): pass
with event.install_listener("numba:compile", Listener()):
    ahead.compile_ahead("phasor", lambda done, total: told.append([done, total]))
missing = [kernel.name for kernel in kernels if kernel.is_missing]
print(json.dumps({{"here": here, "told": told, "missing": missing}}))
"""


def compiled(cache: Path, before: str = "", **environment: str) -> dict[str, list[object]]:
    """What a process of its own, whose cache is empty, compiles itself, is told and leaves to be compiled."""
    said = subprocess.run(
        [sys.executable, "-c", COMPILE.format(before=before, names=SMALL)],
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache), **environment},
        capture_output=True,
        text=True,
        check=True,
        timeout=170,
    )
    found: dict[str, list[object]] = json.loads(said.stdout)
    return found


def test_kernels_are_compiled_in_other_processes_and_kept(tmp_path: Path) -> None:
    first = compiled(tmp_path)
    assert first == {"here": [], "told": [[k, len(SMALL)] for k in range(1, 6)], "missing": []}
    assert compiled(tmp_path) == {"here": [], "told": [], "missing": []}


BROKEN = {
    "no process": "def absent(*_, **__): raise OSError(11, 'no process')\nahead.subprocess.Popen = absent",
    "one that dies": "ahead._CODE = 'import sys; sys.stdin.readline(); raise SystemExit(3)'",
}


@pytest.mark.parametrize("fault", BROKEN)
def test_what_others_do_not_compile_is_compiled_here(tmp_path: Path, fault: str) -> None:
    found = compiled(tmp_path, BROKEN[fault])
    assert {name.rsplit(".", 1)[1] for name in SMALL} <= set(map(str, found["here"]))
    assert found["told"] == [[k, len(SMALL)] for k in range(1, 6)]
    assert found["missing"] == []


def test_where_nothing_can_be_kept_the_kernels_are_compiled_here(tmp_path: Path) -> None:
    only = "from pathlib import Path; from solver.runtime import caching"
    (tmp_path / "file").write_text("where a folder should be")
    found = compiled(tmp_path, f"{only}; caching._choices = lambda *_: [Path({str(tmp_path / 'file')!r})]")
    assert {name.rsplit(".", 1)[1] for name in SMALL} <= set(map(str, found["here"]))
    assert found["told"] == [[k, len(SMALL)] for k in range(1, 6)]


def test_nothing_is_compiled_where_compiling_is_switched_off(tmp_path: Path) -> None:
    found = compiled(tmp_path, NUMBA_DISABLE_JIT="1")
    assert found == {"here": [], "told": [], "missing": []}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_kernel_that_a_method_calls_is_listed() -> None:
    code = "import json; from signatures import listed; print(json.dumps(listed()))"
    said = subprocess.run(
        [sys.executable, "-c", code],
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": f"{ROOT}:{ROOT / 'tests' / 'benchmarks'}"},
        capture_output=True,
        text=True,
        check=True,
        timeout=590,
    )

    def known(rows: list[dict[str, object]]) -> list[tuple[object, ...]]:
        return [(row["name"], row["arguments"], row["methods"]) for row in rows]

    again = "solver/runtime/signatures.json is not what is called: run python tests/benchmarks/signatures.py"
    assert known(json.loads(said.stdout)) == known(json.loads(TABLE.read_text())), again


def test_a_method_that_is_not_listed_has_compiled_what_all_call(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []

    def note(self: Listed) -> None:
        taken.append(self.name)

    monkeypatch.setattr(ahead, "_processes", lambda: 0)
    monkeypatch.setattr(Listed, "is_missing", property(lambda _: True))
    monkeypatch.setattr(Listed, "compile", note)
    compile_ahead("ibsr")
    assert "solver.kernels.relaxation.relax_rows" in taken
    assert "solver.kernels.newton.descend" not in taken
    taken.clear()
    compile_ahead("phasor")
    assert taken[:3] == [kernel.name for kernel in table() if "phasor" in kernel.methods][:3]
    assert "solver.kernels.newton.descend" in taken
