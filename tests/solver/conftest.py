"""Scenes for the solver's tests, with truth."""

import pytest
from made_bursts import Burst, burst


@pytest.fixture(scope="session", params=[0.003, 0.01, 0.03], ids=lambda s: f"{1000 * s:g}mm")
def noisy_burst(request: pytest.FixtureRequest) -> tuple[float, Burst]:
    """(noise, burst) at three noise levels."""
    return request.param, burst(request.param)
