"""What Numba keeps on disk is compiled anew when anything that went into it has changed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import solver

PACKAGE = Path(solver.__file__).parent

KERNEL = """
from numba import njit
from solver.kernels.helper import twice

@njit(cache=True)
def kernel(x):
    return twice(x) + 1
"""

HELPER = """
from numba import njit
from solver.kernels.constants import FACTOR

@njit
def twice(x):
    return FACTOR * x
"""

CALL = """
from solver.kernels.kernel import kernel
print(kernel(10), sum(kernel.stats.cache_hits.values()))
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Holds a copy of the package with a kernel that takes in a function, which takes in a constant."""
    shutil.copytree(PACKAGE, tmp_path / "solver", ignore=shutil.ignore_patterns("__pycache__"))
    kernels = tmp_path / "solver" / "kernels"
    (kernels / "kernel.py").write_text(KERNEL)
    (kernels / "helper.py").write_text(HELPER)
    (kernels / "constants.py").write_text("FACTOR = 2\n")
    return tmp_path


def called(root: Path, **variables: str) -> list[int]:
    """The kernel's value in a process of its own, and whether it came from the cache."""
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", **variables}
    done = subprocess.run(
        [sys.executable, "-c", CALL], env=environment, cwd=root, check=True, capture_output=True, text=True
    )
    return [int(word) for word in done.stdout.split()]


@pytest.mark.parametrize("place", ["solver/kernels/__pycache__", "elsewhere"])
def test_a_kernel_follows_every_source_it_is_compiled_from(root: Path, place: str) -> None:
    variables = {} if "__pycache__" in place else {"NUMBA_CACHE_DIR": str(root / place)}
    kernels = root / "solver" / "kernels"
    assert called(root, **variables) == [21, 0]
    assert list((root / place).rglob("kernel.kernel-*.nbi"))
    assert called(root, **variables) == [21, 1]
    (kernels / "constants.py").write_text("FACTOR = 3\n")
    assert called(root, **variables) == [31, 0]
    (kernels / "helper.py").write_text(HELPER.replace("FACTOR * x", "FACTOR - x"))
    assert called(root, **variables) == [-6, 0]
    assert called(root, **variables) == [-6, 1]


def test_every_kernel_is_compiled_after_the_cache_knows() -> None:
    """Whatever is imported first: another stamp would have kernels compiled again and again."""
    for path in PACKAGE.rglob("*.py"):
        if "cache=True" in path.read_text():
            assert "solver.runtime" in imported(module(path)), path


def module(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


def imported(name: str, seen: frozenset[str] = frozenset()) -> frozenset[str]:
    """The modules of the package that are imported with one."""
    parts = name.split(".")
    packages = [".".join(parts[:n]) for n in range(1, len(parts))]
    path = PACKAGE.parent.joinpath(*parts)
    source = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text()
    names = re.findall(r"^(?:from|import) (solver[.\w]*)", source, re.MULTILINE)
    for other in {*packages, *names} - seen - {name}:
        seen |= {other} | imported(other, seen | {name, other})
    return seen
