"""Small jobs for an executor."""

from scripted import calibration, frame

from service.config.sections import FusionSection
from service.fusion.executor import Executor
from service.fusion.job import BurstJob, FrameJob, Job
from service.messages.burst import Burst
from service.messages.map import FusedMap

SETTINGS = FusionSection(method="nearest", upsampling=2, register_poses=False, timeout=30.0)


def job(number: int, kind: type[Burst] = Burst, settings: FusionSection = SETTINGS, **changes: object) -> Job:
    frames = tuple(frame(k, k * 1000, **changes) for k in range(3))
    return BurstJob(kind(number, frames, calibration(), 3), settings)


def frame_job(number: int, stream: int = 1, window: int = 3, **changes: object) -> FrameJob:
    return FrameJob(frame(number, number * 1000, **changes), calibration(), SETTINGS, window, stream, number)


def map_of(executor: Executor, job: Job) -> FusedMap:
    return executor.submit(job).result(60)
