"""Frames of a depth camera that gives metres and nothing else."""

import numpy as np

from drivers import Frame
from drivers.calibration import Calibration, Intrinsics
from drivers.frame import ambiguity_range

SHAPE = 36, 48
START = 1_700_000_000_000_000_000
KNOWN = Calibration(
    width=48, height=36, intrinsics=Intrinsics(fx=45.0, fy=45.0, cx=23.5, cy=17.5), source="made"
)


def depth_frames(count=6, *, amplitude=False, scaled=False, frequency=None):
    """A step behind which there is a slope, from slightly different places."""
    random = np.random.default_rng(5)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    frames = []
    for number in range(count):
        dy, dx = random.uniform(-0.5, 0.5, 2) * (number > 0)
        metres = 2.0 + 0.01 * (rows + dy) - 0.4 * ((columns + dx) > 24) * ((rows + dy) > 12)
        metres = (metres + random.normal(0, 0.004, SHAPE)).astype(np.float32)
        metres[0, :3] = np.nan
        counts = np.nan_to_num(metres * 1000).astype(np.uint16) if scaled else metres
        light = (2000 + 500 * (columns > 24)).astype(np.uint16) if amplitude else None
        frames.append(
            Frame(
                counts=counts,
                amplitude=light,
                timestamp=START + number * 33_000_000,
                sequence=number,
                pan=0.0,
                tilt=0.0,
                integration_time=None,
                modulation_frequency=frequency,
                ambiguity_range=None if frequency is None else ambiguity_range(frequency),
                burst=0,
                pose=number,
                scale=1e-3 if scaled else None,
            )
        )
    return frames
