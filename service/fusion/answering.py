"""What runs inside the fusion's process: jobs in, maps out."""

import time
from collections.abc import Callable

import numpy as np

from drivers.calibration import Calibration, Intrinsics
from drivers.frame import Frame
from service.errors import internal
from service.fusion.fuse import fuse_burst
from service.fusion.job import Answer, BurstJob, Compiling, Failure, FrameJob, Iterating, Job, Ready, WarmUp
from service.fusion.streams import Stream
from service.messages.burst import Burst
from service.processes.worker import tell
from solver.errors import FusionError
from solver.result import Progress
from solver.runtime.ahead import compile_ahead

_BETWEEN_WORDS = 0.2
"""Seconds between two words on how far the solver is."""


def answering() -> Callable[[Job | WarmUp], Answer]:
    """What answers each request in turn; it remembers the stream at work."""
    _forgo_blas()
    streams: dict[int, Stream] = {}

    def answer(request: Job | WarmUp) -> Answer:
        try:
            if isinstance(request, WarmUp):
                return warm_up(request)
            if isinstance(request, BurstJob):
                return fuse_burst(request.burst, request.settings, _iterations_told())
            return _stream(streams, request).push(request)
        except FusionError as error:
            return Failure(str(error))
        except Exception as error:  # whatever it is, the daemon has to know and to go on
            return Failure(internal(error))

    return answer


def _forgo_blas() -> None:
    """Spare Numba a third of a second, in which it would import SciPy for products of matrices in kernels.

    No kernel has one; where one did, compiling it would fail here.
    """
    from numba.np import linalg

    def absent() -> None:
        raise ImportError("not used here")

    linalg.ensure_blas = absent


def _iterations_told() -> Progress:
    """Tells how far the solver is, some times a second."""
    told = time.monotonic()

    def progress(iteration: int, objective: float | None, gap: float | None) -> None:
        nonlocal told
        now = time.monotonic()
        if now - told >= _BETWEEN_WORDS:
            told = now
            tell(Iterating(iteration, objective, gap))

    return progress


def _stream(streams: dict[int, Stream], job: FrameJob) -> Stream:
    if job.stream not in streams:
        streams.clear()  # there is one at a time
        streams[job.stream] = Stream(job)
    return streams[job.stream]


def warm_up(request: WarmUp) -> Ready:
    """Have the kernels of the configured method compiled, and load them for a small scene."""
    began = time.perf_counter()
    method = request.settings.method
    compile_ahead("phasor" if method == "auto" else method, lambda done, total: tell(Compiling(done, total)))
    fuse_small_scenes(request)
    return Ready(time.perf_counter() - began)


def fuse_small_scenes(request: WarmUp) -> None:
    frames, calibration = _small_scene(3 if request.window is None else request.window + 3)
    fuse_burst(Burst(0, frames[:3], calibration, 3), request.settings)
    if request.window is not None:
        jobs = [
            FrameJob(frame, calibration, request.settings, request.window, 0, number)
            for number, frame in enumerate(frames)
        ]
        stream = Stream(jobs[0])
        for job in jobs:
            stream.push(job)


def _small_scene(count: int) -> tuple[tuple[Frame, ...], Calibration]:
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
        for k in range(count)
    )
    return frames, Calibration(width=width, height=height, intrinsics=intrinsics)
