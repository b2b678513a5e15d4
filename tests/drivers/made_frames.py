"""Frames for tests of recordings: a slope with noise, so that they compress as real ones do."""

import numpy as np

from drivers import Frame

START = 1_700_000_000_123_456_789
PERIOD = 20_000_000
SHAPE = (144, 176)


def make_frame(number, *, burst=None, pose=None, shape=SHAPE, seed=0, **changes):
    random = np.random.default_rng((seed, number))
    slope = np.linspace(10_000, 30_000, shape[0] * shape[1]).reshape(shape)
    fields = {
        "counts": (slope + random.normal(0, 90, shape)).astype(np.uint16),
        "amplitude": random.normal(3000, 30, shape).astype(np.uint16),
        "timestamp": START + number * PERIOD,
        "sequence": 100 + number,
        "pan": 0.001 * number,
        "tilt": -0.0021 * number,
        "integration_time": 0.003,
        "modulation_frequency": 20e6,
        "ambiguity_range": 7.5,
        "timestamp_uncertainty": 1_500,
        "burst": burst,
        "pose": pose,
    }
    return Frame(**fields | changes)


def make_bursts(bursts, frames_per_burst):
    return [
        make_frame(burst * frames_per_burst + pose, burst=burst, pose=pose)
        for burst in range(bursts)
        for pose in range(frames_per_burst)
    ]


FIELDS = [name for name in Frame.__dataclass_fields__ if name not in ("counts", "amplitude")]


def assert_same_frame(got, expected):
    for name in ("counts", "amplitude"):
        assert getattr(got, name).dtype == np.uint16
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    assert {name: getattr(got, name) for name in FIELDS} == {name: getattr(expected, name) for name in FIELDS}
