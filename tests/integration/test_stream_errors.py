"""A stream is as good as a burst of the same frames."""

from pathlib import Path

import numpy as np
import pytest

from drivers.recording import open_recording
from service.config.sections import FusionSection
from service.fusion.fuse import fuse_burst
from service.fusion.job import FrameJob
from service.fusion.streams import Stream
from service.messages.burst import Burst

RECORDING = Path(__file__).parents[2] / "recordings" / "wedges.mcap"


def test_maps_of_a_growing_window_are_as_good_as_those_of_a_burst() -> None:
    recording = open_recording(RECORDING)
    frames, calibration, truth = tuple(recording.frames())[:6], recording.calibration, recording.truth
    settings = FusionSection(method="phasor")
    jobs = [FrameJob(frame, calibration, settings, 15, 0, number) for number, frame in enumerate(frames)]
    stream = Stream(jobs[0])
    streamed = [stream.push(job) for job in jobs][-1]
    whole = fuse_burst(Burst(0, frames, calibration, len(frames)), settings)
    assert streamed.report.used == whole.report.used
    for power in (1, 2):
        off, least = (np.nanmean(abs(one.distance - truth) ** power) for one in (streamed, whole))
        assert off ** (1 / power) == pytest.approx(least ** (1 / power), rel=0.05)
