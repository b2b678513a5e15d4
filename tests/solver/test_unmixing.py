"""Mixed pixels are given to one of their two surfaces."""

import numpy as np
import pytest

from solver.unmixing import unmix


def edge(share: float, near: complex, far: complex) -> np.ndarray:
    """(2, 21, 21): `near` on the left, `far` on the right, column 10 a mixture with that share of `near`."""
    z = np.full((21, 21), far)
    z[:, :10] = near
    z[:, 10] = share * near + (1 - share) * far
    return np.stack([z.real, z.imag]).astype(np.float32)


@pytest.mark.parametrize(("share", "left"), [(0.2, False), (0.4, False), (0.6, True), (0.9, True)])
def test_a_mixture_goes_to_the_side_that_fills_more_of_it(share: float, left: bool) -> None:
    near, far = 2.0 * np.exp(1.2j), 0.5 * np.exp(2.6j)  # the near side is four times as bright
    real, imaginary = unmix(edge(share, near, far))
    assert np.angle(real + 1j * imaginary)[10, 10] == pytest.approx(1.2 if left else 2.6, abs=0.02)


def test_a_smooth_map_stays_as_it_is() -> None:
    columns = np.arange(40) * 0.01
    z = np.broadcast_to(np.exp(1j * columns), (30, 40))
    parts = np.stack([z.real, z.imag]).astype(np.float32)
    assert np.array_equal(unmix(parts), parts)


def test_what_is_no_mixture_of_its_neighbours_stays() -> None:
    z = edge(0.5, 1.0, 1.0j)
    z[:, :, 10] = [[-1.0], [-1.0]]
    assert np.array_equal(unmix(z)[:, :, 10], z[:, :, 10])
