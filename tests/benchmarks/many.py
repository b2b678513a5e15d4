"""What it costs to send many recordings to a cluster: `python tests/benchmarks/many.py [--recordings 64]`.

The command `lidarboost fuse` over a folder, by the local pool and by a real scheduler with as many workers on
this machine as `dask worker` starts them, in turn, each solver with one thread. The first row of the cluster
finds workers that have just begun and have loaded nothing yet. Of each command: whole, from its start to its
end; until its first recording was fused; and from there on by recording.

Run it on an idle machine; targets are in the heads of the columns.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "service")]

from dask_cluster import dask_cluster  # noqa: E402

SCENES = "wedges", "objects"


@dataclass(frozen=True, slots=True)
class Run:
    """Seconds of a command: whole, until the first recording was fused, and by recording from there on."""

    whole: float
    first: float
    each: float


def copies(folder: Path, count: int) -> Path:
    """A folder of so many recordings, the bundled ones in turn."""
    folder.mkdir()
    for number in range(count):
        scene = SCENES[number % len(SCENES)]
        shutil.copy(ROOT / "recordings" / f"{scene}.mcap", folder / f"{number:04}-{scene}.mcap")
    return folder


def fused(recordings: Path, output: Path, *how: str) -> Run:
    """Fuse a folder; the results are removed again."""
    words = [sys.executable, "-m", "lidarboost", "fuse", str(recordings), "--output", str(output), *how]
    began = time.monotonic()
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    with subprocess.Popen(
        words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        wrote = (line for line in process.stdout if line.startswith("wrote"))
        ends = [time.monotonic() - began for _ in wrote]
    whole = time.monotonic() - began
    count = len(list(recordings.iterdir()))
    assert (process.returncode, len(ends)) == (0, count), f"{len(ends)} of {count} recordings were fused"
    shutil.rmtree(output)
    return Run(whole, ends[0], (ends[-1] - ends[0]) / (count - 1))


def told(name: str, run: Run) -> None:
    print(f"{name:<24} {run.whole:>8.1f} s {run.first:>8.2f} s {1e3 * run.each:>10.0f} ms", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=64, help="how many")
    parser.add_argument("--rounds", type=int, default=2, help="of pool and cluster in turn")
    parser.add_argument("--one-worker", action="store_true", help="also one worker of the pool")
    chosen = parser.parse_args()
    workers = len(os.sched_getaffinity(0))
    print(f"{chosen.recordings} recordings, {workers} workers, load {os.getloadavg()[0]:.1f} before")
    print(f"{'':<24} {'whole':>10} {'first':>10} {'each after':>13}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        scans, few = copies(folder / "scans", chosen.recordings), copies(folder / "few", workers)
        fused(few, folder / "out", "--workers", str(workers))
        pool, cluster = [], []
        with dask_cluster(folder / "dask", workers, nannies=True) as dask:
            for number in range(chosen.rounds):
                pool.append(fused(scans, folder / "out", "--workers", str(workers)))
                told("pool", pool[-1])
                cluster.append(fused(scans, folder / "out", "--cluster", dask.address))
                told("cluster" if number else "cluster, fresh workers", cluster[-1])
        more = mean(run.whole for run in cluster) / mean(run.whole for run in pool) - 1
        each = mean(run.each for run in cluster) / mean(run.each for run in pool) - 1
        start = mean(run.first for run in cluster) - mean(run.first for run in pool)
        print(
            f"cluster against pool: whole {more:+.1%} (5 %), by recording {each:+.1%}, "
            f"until the first {start:+.2f} s"
        )
        if chosen.one_worker:
            alone = fused(scans, folder / "out", "--workers", "1")
            told("pool, one worker", alone)
            print(
                f"{workers} workers are {alone.whole / mean(run.whole for run in pool):.2f} times one (1.8)"
            )


if __name__ == "__main__":
    main()
