"""Where the parts of pixels behind a distorting lens look."""

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.lens import straightened


def footprint_places(calibration: Calibration) -> NDArray[np.float64]:
    """(H, W, 5, 5, 2) column and row, without distortion, of a lattice over each pixel's sensitive square."""
    height, width = calibration.shape
    steps = np.linspace(-0.5, 0.5, 5) * calibration.footprint.fill_factor
    rows, columns = (np.arange(n)[:, None] + steps for n in (height, width))
    lattice = np.empty((height, width, 5, 5, 2))
    lattice[..., 0] = columns[None, :, None, :]
    lattice[..., 1] = rows[:, None, :, None]
    return straightened(lattice, calibration)
