"""Bursts whose fusion waits for a file, so that a test knows who is at work on them, and until when."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

from scripted import calibration, frame

from service.config.sections import FusionSection
from service.fusion.job import BurstJob
from service.messages.burst import Burst

_PATIENCE = 100.0


@dataclass(frozen=True, slots=True)
class GatedBurst(Burst):
    """Arrives where it is fused once the file `open` is in a folder; tells there who waits for it."""

    gate: Path = Path()

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return _arrive, (self.id, self.frames, self.calibration, self.expected, self.completed, self.gate)


def _arrive(number: int, frames, calibration, expected, completed, gate: Path) -> Burst:  # type: ignore[no-untyped-def]
    (gate / f"{number}.{os.getpid()}").touch()
    end = time.monotonic() + _PATIENCE
    while not (gate / "open").exists() and time.monotonic() < end:
        time.sleep(0.02)
    return Burst(number, frames, calibration, expected, completed)


def gated(number: int, gate: Path, settings: FusionSection) -> BurstJob:
    frames = tuple(frame(k, k * 1000) for k in range(3))
    return BurstJob(GatedBurst(number, frames, calibration(), 3, gate=gate), settings)


def waiting(gate: Path, number: int) -> list[int]:
    """Ids of the processes that have begun with a burst."""
    return [int(path.suffix[1:]) for path in gate.glob(f"{number}.*")]
