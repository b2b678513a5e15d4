"""How much of a processor core capture over USB takes, and whether frames are dropped.

    python tests/benchmarks/usb_rate.py --seconds 600 [--record out.mcap]

The real driver reads frames of 101 376 bytes at 50 frames/s from a stand-in behind pyusb, whose own work (a
copy of a prepared frame) is counted too. Without `--record`, the figure is that of capture alone; with it,
the service's recorder writes the frames from its own thread, and its work is counted too.
"""

import argparse
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "drivers")]

import numpy as np  # noqa: E402
from usb_standin import StandIn, scene  # noqa: E402

from drivers.calibration import Mount  # noqa: E402
from drivers.messages import frame_messages  # noqa: E402
from drivers.usb import UsbCamera, discovery  # noqa: E402
from service.sinks.recorder import Recorder  # noqa: E402
from service.sinks.recording_directory import SingleFile  # noqa: E402

RATE = 50.0
PERIOD = 0.012
"""Seconds from trigger to frame in the stand-in: 4 · 3 ms, which leaves the driver time to be late."""

LATE = 1.5e3 / RATE
"""Milliseconds between two frames from which the later one counts as late."""


def measure(seconds: float, record: Path | None = None) -> dict[str, float]:
    """Frames, drops, rate, jitter and share of one core over a time."""
    prepared = [scene(144, 176, number) for number in range(8)]
    stand_in = StandIn(period=PERIOD, frames=lambda number: prepared[number % 8], record=False)
    discovery.libusb = lambda: stand_in  # type: ignore[assignment]
    camera = UsbCamera(UsbCamera.Options(allow_inferred=True))
    camera.open()
    camera.start()
    recorder = Recorder(SingleFile(record)) if record is not None else None
    if recorder is not None:
        recorder.start()
    frame_messages(camera.grab(), Mount())  # the first one imports what the others use
    stamps, sequences = [], []
    started, cpu = time.monotonic(), time.process_time()
    due = started
    while (now := time.monotonic()) < started + seconds:
        # the SR4000's documented readout allows 42 frames/s, so the schedule is kept here
        time.sleep(max(0.0, due - now))
        due += 1 / RATE
        frame = camera.grab()
        stamps.append(frame.timestamp)
        sequences.append(frame.sequence)
        if recorder is not None:
            recorder.record(frame_messages(frame, Mount()))
    elapsed, used = time.monotonic() - started, time.process_time() - cpu
    lost = recorder.stop().dropped if recorder is not None else 0
    camera.close()
    periods = np.diff(stamps) / 1e6
    return {
        "seconds": round(elapsed, 1),
        "frames": len(sequences),
        "drops": sequences[-1] - sequences[0] + 1 - len(sequences),
        "not_recorded": lost,
        "rate": round(len(sequences) / elapsed, 2),
        "late": int(np.count_nonzero(periods > LATE)),
        "longest_period_ms": round(float(periods.max()), 1),
        "p99_period_ms": round(float(np.percentile(periods, 99)), 1),
        "share_of_core": round(used / elapsed, 4),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--record", type=Path)
    arguments = parser.parse_args()
    print(json.dumps(measure(arguments.seconds, arguments.record)))
