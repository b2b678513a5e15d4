"""A recording of two bursts, and its frames."""

import pytest
from made_frames import make_bursts
from made_recordings import write

from drivers import sr4000_calibration


@pytest.fixture(scope="module")
def frames():
    return make_bursts(2, 15)


@pytest.fixture(scope="module")
def whole(frames, tmp_path_factory):
    return write(tmp_path_factory.mktemp("recording") / "whole.mcap", frames, sr4000_calibration())
