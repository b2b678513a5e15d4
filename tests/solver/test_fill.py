"""What is taken for unseen pixels."""

import numpy as np
import pytest

from solver.optimisation.fill import smoothed


@pytest.mark.parametrize("factor", [2, 12, 40, 64])
def test_lone_samples_stand_for_what_is_around_them(factor: int) -> None:
    """However thinly the weight of one spreads."""
    weight = np.zeros((2 * factor, 3 * factor), np.float32)
    weight[factor // 2 :: factor, factor // 2 :: factor] = 0.7
    found = smoothed(np.where(weight > 0, np.float32(7), 0), weight, factor)
    np.testing.assert_allclose(found, 7, rtol=1e-5)
