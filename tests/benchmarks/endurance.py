"""A service under faults, and what it cannot account for.

`python tests/benchmarks/endurance.py [--minutes 10]`

It streams, then scans, a simulated camera for so many minutes each, while one sink raises now and then, one
hangs, one is slow, and the process that fuses is stopped in turn. In the end every frame is recorded, and has
become a map, or is counted among those that gave way or failed; every map reached a sink that is well. The
exit status says so.
"""

import argparse
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from drivers.recording import open_recording
from service.capture.configured import make_rig
from service.config.file import load
from service.daemon.daemon import Daemon
from service.daemon.run import run_service
from service.fusion.backlog import Backlog
from service.messages.events import Event, FrameCaptured, MapFused
from service.sinks.sink import Sink

FAULT_EVERY = 20.0
"""Seconds from one fault to the next."""


class Counts(Sink):
    """What a sink that is well receives."""

    def __init__(self) -> None:
        super().__init__()
        self.frames = self.maps = 0

    def take(self, event: Event) -> None:
        self.frames += isinstance(event, FrameCaptured)
        self.maps += isinstance(event, MapFused)


class Raises(Sink):
    """On every hundredth event."""

    seen = 0

    def take(self, event: Event) -> None:  # noqa: ARG002
        Raises.seen += 1
        if Raises.seen % 100 == 0:
            raise RuntimeError("one in a hundred")


class Hangs(Sink):
    """Twice."""

    seen = 0
    let_go = threading.Event()

    def take(self, event: Event) -> None:  # noqa: ARG002
        Hangs.seen += 1
        if Hangs.seen in (200, 2000):
            self.let_go.wait()


class Slow(Sink):
    """Ten events a second."""

    def take(self, event: Event) -> None:  # noqa: ARG002
        time.sleep(0.1)


def run(start: str, minutes: float, folder: Path) -> bool:
    """One mode; whether all is accounted for."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    (folder / "zenoh.json5").write_text(f'{{ listen: {{ endpoints: ["{endpoint}"] }} }}')
    sections: dict[str, Any] = {
        "start": start,
        "camera": {"backend": "simulated", "settings": {"integration_time": 0.005}},
        "stage": {"backend": "simulated" if start == "scan" else "none", "settle": 0.0},
        "fusion": {"method": "lidarboost"},
        "zenoh": {"config": str(folder / "zenoh.json5")},
        "recording": {"enabled": True, "directory": str(folder / "kept"), "maps": False},
    }
    configuration = load(None, sections)
    counts, over = Counts(), threading.Event()
    backlogs: list[Backlog] = []

    def meddle(daemon: Daemon) -> None:
        while counts.maps == 0 and not over.wait(0.2):
            pass  # kernels are loaded, or compiled
        end = time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            over.wait(min(FAULT_EVERY, max(0.0, end - time.monotonic())))
            pid = daemon.fusing.executor.pid
            if pid is not None and time.monotonic() < end - FAULT_EVERY:
                os.kill(pid, signal.SIGSTOP)
        daemon.stop.set()

    def started(daemon: Daemon) -> None:
        backlogs.append(daemon.fusing.backlog)
        threading.Thread(target=meddle, args=(daemon,), daemon=True).start()

    sinks = {"counts": lambda: counts, "raises": Raises, "hangs": Hangs, "slow": Slow}
    summary = run_service(configuration, make_rig(configuration), sinks=sinks, started=started)
    over.set()
    Hangs.let_go.set()
    recorded = sum(open_recording(path).frame_count for path in (folder / "kept").glob("*.mcap"))
    print(
        f"{start}: {summary.frames} frames, {recorded} recorded, {summary.maps} maps, {summary.seconds:.0f} s"
    )
    for loss in summary.lost:
        print("  lost:", loss)
    (backlog,) = backlogs
    given = summary.frames if start == "stream" else summary.bursts
    print(
        f"  {given} {'frames' if start == 'stream' else 'bursts'} to be fused: {backlog.fused} fused, "
        f"{backlog.failed} failed, {backlog.dropped + backlog.skipped} gave way, {backlog.cancelled} left"
    )
    fine = (
        counts.frames == summary.frames == recorded
        and counts.maps == summary.maps == backlog.fused > 0
        and given == backlog.fused + backlog.failed + backlog.dropped + backlog.skipped + backlog.cancelled
    )
    print(
        "  all accounted for" if fine else f"  NOT accounted for: {counts.frames} frames, {counts.maps} maps"
    )
    return fine


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="for each of the two modes")
    minutes = parser.parse_args().minutes
    results = []
    for start in ("stream", "scan"):
        with tempfile.TemporaryDirectory() as folder:
            results.append(run(start, minutes, Path(folder)))
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
