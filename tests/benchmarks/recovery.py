"""How long a service takes to be itself again after each fault, once its cause is gone.

`python tests/benchmarks/recovery.py [FAULT…]`

It runs `lidarboost run` in a process of its own with an SR4000 behind pyusb, a pan-tilt unit on a
pseudo-terminal and a recorder on a disk of its own, breaks one thing after the other at its true place, mends
it, and prints the seconds from there until maps come again, all is recorded, and nothing is `degraded`. The
target is 5 s; the exit status says whether it was met. A process that hangs is mended by being given up.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "integration"), str(ROOT / "tests" / "drivers")]

from emulators.ptu_emulator import PtuEmulator  # noqa: E402
from rig_process import PLUGGED, RigProcess, rig_process  # noqa: E402

TARGET = 5.0

RIG = (
    PLUGGED
    + """
[stage]
backend = "ptu"
options = { port = "FOLDER/ptu" }
home = "at start"
"""
)

Broken = Callable[[], None]
"""Mends it."""


class Bench:
    """A rig at work, and what can be broken of it."""

    def __init__(self, rig: RigProcess, unit: PtuEmulator, disk: Path | None) -> None:
        self.rig, self.unit, self.disk = rig, unit, disk

    def camera_unplugged(self) -> Broken:
        self.rig.tell_camera("unplug")
        self.rig.wait_state("recovering")
        time.sleep(4.0)
        return lambda: self.rig.tell_camera("replug")

    def camera_silent(self) -> Broken:
        self.rig.tell_camera("silence")
        self.rig.wait_state("recovering")
        time.sleep(4.0)
        return lambda: self.rig.tell_camera("talk")

    def stage_unplugged(self) -> Broken:
        self.unit.unplug()
        self.rig.wait_state("recovering")
        time.sleep(4.0)
        return self.unit.plug

    def worker_killed(self) -> Broken:
        self.rig.wait(lambda told: told["fusion"]["spare"], 300)
        os.kill(self.worker, signal.SIGKILL)
        return lambda: None

    def worker_stopped(self) -> Broken:
        """The cause is gone once the one that hangs is given up."""
        restarts = self.rig.wait(lambda told: told["fusion"]["spare"], 300)["fusion"]["restarts"]
        os.kill(self.worker, signal.SIGSTOP)
        self.rig.wait(lambda told: told["fusion"]["restarts"] > restarts)
        return lambda: None

    def disk_full(self) -> Broken:
        assert self.disk is not None
        filler = self.disk / "filler"
        with filler.open("wb") as file:
            try:
                while file.write(bytes(1 << 16)):
                    file.flush()
            except OSError:
                pass
        self.rig.wait(lambda told: told["recorder"]["error"])
        time.sleep(3.0)
        return filler.unlink

    def folder_deleted(self) -> Broken:
        lost = self.rig.status["recorder"]["lost"]
        shutil.rmtree(self.rig.folder / "disk" / "recordings")
        self.rig.wait(lambda told: told["recorder"]["lost"] > lost)
        return lambda: None

    @property
    def worker(self) -> int:
        """The process that fuses: the child of the service that was started with its name."""
        pid = self.rig.process.pid
        threads = Path(f"/proc/{pid}/task").iterdir()
        children = {int(one) for thread in threads for one in (thread / "children").read_text().split()}
        return min(  # the spare one is younger
            one for one in children if b"fusion.answering" in Path(f"/proc/{one}/cmdline").read_bytes()
        )

    def normal(self, since: float) -> float:
        """Seconds until another map has come and all is well."""
        fused = self.rig.status["totals"]["fused"]
        self.rig.wait(lambda told: told["totals"]["fused"] > fused and well(told), 90)
        return time.monotonic() - since


def well(told: dict[str, object]) -> bool:
    recorder = told["recorder"]
    return told["state"] == "scanning" and not told["degraded"] and bool(recorder["recording"])  # type: ignore[index]


@contextmanager
def mounted(folder: Path) -> Iterator[Path | None]:
    """A file system of 64 MB, or None where none can be mounted."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    try:
        yield folder if done.returncode == 0 else None
    finally:
        subprocess.run(["umount", "-l", str(folder)], capture_output=True, check=False)


FAULTS = (
    "camera_unplugged",
    "camera_silent",
    "stage_unplugged",
    "worker_killed",
    "worker_stopped",
    "disk_full",
    "folder_deleted",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("faults", nargs="*", metavar="FAULT", help=f"of {', '.join(FAULTS)}; none = all")
    chosen = parser.parse_args().faults or FAULTS
    slow = 0
    print(f"{'fault':<20} {'seconds':>8}   (target {TARGET:g})", flush=True)
    with tempfile.TemporaryDirectory() as name, mounted(Path(name) / "disk") as disk:
        folder = Path(name)
        with (
            PtuEmulator(folder / "ptu") as unit,
            rig_process(folder, RIG.replace("FOLDER", name), "scan") as rig,
        ):
            rig.wait(lambda told: told["totals"]["fused"] >= 4, 300)
            bench = Bench(rig, unit, disk)
            for fault in chosen:
                if disk is None and fault.startswith("disk"):
                    print(f"{fault:<20} {'–':>8}   file systems cannot be mounted here")
                    continue
                mend = getattr(bench, fault)()
                since = time.monotonic()
                mend()
                seconds = bench.normal(since)
                slow += seconds > TARGET
                print(f"{fault:<20} {seconds:8.1f}", flush=True)
    return int(slow > 0)


if __name__ == "__main__":
    sys.exit(main())
