"""Results of benchmarks on the disk: what was measured, at which commit and on which machine."""

import json
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numba
import numpy as np

ROOT = Path(__file__).parents[2]
RESULTS = Path(__file__).parent / "results"

Results = dict[str, Any]


def store(path: Path, **results: Any) -> None:
    """Write results, with where and of what they were measured."""
    head = {"commit": commit(), "date": f"{datetime.now(UTC):%Y-%m-%d}", "machine": machine()}
    path.write_text(json.dumps(head | results, indent=1) + "\n")


def load(name: str) -> Results:
    """What `results/NAME.json` holds."""
    found: Results = json.loads((RESULTS / f"{name}.json").read_text())
    return found


def commit() -> str:
    """The commit that is measured, with a + where files differ from it."""

    def said(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout

    changed = bool(
        said("status", "--porcelain", "--untracked-files=no", "--", "solver", "drivers", "service")
    )
    return said("rev-parse", "--short", "HEAD").strip() + "+" * changed


def machine() -> dict[str, str | int]:
    """What a time depends on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }
