"""Memory and file descriptors of a service that scans, after a twelfth of the time and at its end.

`python tests/benchmarks/memory.py [--minutes 60]`

Both of the service and of the process that fuses. The target is at most 2 % more memory and not one
descriptor more; the exit status says whether it was met.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "integration")]

from rig_process import SIMULATED, RigProcess, rig_process  # noqa: E402

MORE = 1.02

TEXT = """
start = "{start}"
{devices}
[camera.settings]
integration_time = 0.004
[fusion]
frames = 8
[recording]
enabled = true
directory = "{folder}/recordings"
rotate_size = 20
budget = 60
[zenoh]
config = "{folder}/zenoh.json5"
"""


@dataclass(frozen=True)
class Use:
    """What processes hold: megabytes (the proportional share of what is shared) and open descriptors."""

    memory: float
    descriptors: int


def used(pids: list[int]) -> Use:
    """By these processes together."""
    memory = descriptors = 0
    for pid in pids:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        memory += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        descriptors += len(list(Path(f"/proc/{pid}/fd").iterdir()))
    return Use(memory / 1000, descriptors)


def processes(rig: RigProcess) -> list[int]:
    """The service and its children."""
    pid = rig.process.pid
    children = [
        int(child)
        for thread in Path(f"/proc/{pid}/task").iterdir()
        for child in (thread / "children").read_text().split()
    ]
    return [pid, *children]


def measured(rig: RigProcess, seconds: float) -> Use:
    """The mean of ten looks over a tenth of the time: a fusion at work holds more than one that waits."""
    looks = []
    for _ in range(10):
        time.sleep(seconds / 100)
        looks.append(used(processes(rig)))
    return Use(sum(one.memory for one in looks) / 10, min(one.descriptors for one in looks))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    seconds = 60 * parser.parse_args().minutes
    with tempfile.TemporaryDirectory() as name, rig_process(Path(name), SIMULATED, "scan", TEXT) as rig:
        rig.wait(lambda told: told["totals"]["fused"] >= 1, 600)
        began = time.monotonic()
        time.sleep(seconds / 12)
        early = measured(rig, seconds)
        time.sleep(max(0.0, seconds * 0.9 - (time.monotonic() - began)))
        late = measured(rig, seconds)
        maps = rig.status["totals"]["fused"]
    ratio = late.memory / early.memory
    print(f"{'after':>10} {'MB':>8} {'descriptors':>12}")
    for minutes, use in ((seconds / 720, early), (seconds / 60, late)):
        print(f"{minutes:6.1f} min {use.memory:8.1f} {use.descriptors:12d}")
    print(f"{maps} maps; ratio {ratio:.3f} (target {MORE:g})")
    return int(ratio > MORE or late.descriptors > early.descriptors)


if __name__ == "__main__":
    sys.exit(main())
