"""A real scheduler and real workers on loopback, each a process of its own."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
Process = subprocess.Popen[bytes]


def until(happened: Callable[[], bool], seconds: float = 90.0) -> None:
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline, "it never happened"
        time.sleep(0.02)


class DaskCluster:
    """As `dask scheduler` and `dask worker` make one; without nannies what is killed stays dead."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file = folder, folder / "scheduler.json"
        self.processes: list[Process] = []
        self.start_scheduler("0")
        until(lambda: self._file.exists() and self._file.stat().st_size > 0)
        self.address: str = json.loads(self._file.read_text())["address"]

    def start_scheduler(self, port: str | None = None) -> None:
        """The scheduler; without a port where the former one was."""
        port = self.address.rpartition(":")[2] if port is None else port
        place = ("--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.scheduler = self._start("dask_scheduler", *place, "--scheduler-file", self._file)

    def start_worker(self, path: Path = ROOT, *, nanny: bool = False) -> Process:
        """One more, with one thread; `path` goes before the source tree."""
        words = ("--nthreads", "1", "--no-dashboard", "--local-directory", self._folder)
        more = () if nanny else ("--no-nanny",)
        return self._start("dask_worker", self.address, *words, *more, path=path)

    def _start(self, module: str, *words: object, path: Path = ROOT) -> Process:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(path), str(ROOT)))}
        command = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words)]
        log = (self._folder / f"{len(self.processes)}.log").open("wb")
        with log:
            process = subprocess.Popen(
                command, cwd=self._folder, env=environment, stdout=log, stderr=subprocess.STDOUT
            )
        self.processes.append(process)
        return process


@contextmanager
def dask_cluster(
    folder: Path, workers: int, path: Path = ROOT, *, nannies: bool = False
) -> Iterator[DaskCluster]:
    folder.mkdir()
    cluster = DaskCluster(folder)
    try:
        for _ in range(workers):
            cluster.start_worker(path, nanny=nannies)
        if workers:
            until(lambda: (folder / "0.log").read_text().count("Register worker") == workers)
        yield cluster
    finally:
        for process in reversed(cluster.processes):
            process.terminate() if nannies else process.kill()  # a nanny ends its worker
            process.wait()
