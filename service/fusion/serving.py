"""What runs inside the fusion worker's process."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from drivers.calibration import Calibration, Intrinsics
from drivers.frame import Frame
from service.config.sections import FusionSection
from service.fusion.fuse import FusedBurst, fuse_burst
from service.messages.burst import Burst
from solver.errors import FusionError

_NICENESS = 5
"""The capture goes first: a late map is late, a late frame is lost."""


@dataclass(frozen=True, slots=True)
class Ready:
    """The process is up and its kernels are compiled, after so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Failure:
    """A burst that could not be fused, and why."""

    reason: str


def serve(pipe: Connection, settings: FusionSection) -> None:
    """Fuse what comes through the pipe until it ends."""
    # Signals to a process group (Ctrl-C, `timeout`) are the parent's alone to answer.
    os.setpgid(0, 0)
    os.nice(_NICENESS)
    with suppress(EOFError, OSError):
        pipe.send(_warm_up(settings))
        while True:
            pipe.send(_fuse(pipe.recv(), settings))


def _fuse(burst: Burst, settings: FusionSection) -> FusedBurst | Failure:
    try:
        return fuse_burst(burst, settings)
    except FusionError as error:
        return Failure(str(error))
    except Exception as error:  # whatever it is, the daemon has to know and to go on
        return Failure(f"internal error, {type(error).__name__}: {error}")


def _warm_up(settings: FusionSection) -> Ready | Failure:
    """Compile the kernels of the configured method on a small scene: a step, seen by three frames."""
    began = time.perf_counter()
    height, width = 48, 64
    intrinsics = Intrinsics(fx=60.0, fy=60.0, cx=(width - 1) / 2, cy=(height - 1) / 2)
    rows, columns = np.mgrid[:height, :width]
    relief = 20_000 + 2_000 * (columns > width // 2) + 500 * np.sin(rows / 5) * np.sin(columns / 7)
    light = 2_000 + 800 * np.sin(rows / 3) * np.sin(columns / 4)
    frames = tuple(
        Frame(
            counts=relief.astype(np.uint16),
            amplitude=light.astype(np.uint16),
            timestamp=0,
            sequence=k,
            pan=0.0,
            tilt=0.0,
            integration_time=0.03,
            modulation_frequency=20e6,
            ambiguity_range=7.5,
        )
        for k in range(3)
    )
    calibration = Calibration(width=width, height=height, intrinsics=intrinsics)
    answer = _fuse(Burst(0, frames, calibration, len(frames)), settings)
    return answer if isinstance(answer, Failure) else Ready(time.perf_counter() - began)
