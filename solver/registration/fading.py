"""The mosaic of a stream: what was added long ago counts less."""

import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import Borders, Grid
from solver.registration.mosaic import Mosaic
from solver.registration.sums import COLD, Sums
from solver.registration.sweep import sweep_and_fade

Image = NDArray[np.float32]


class FadingSums(Sums):
    """Sums that fade with every mosaic, to nothing or to what is held of them for good.

    Args:
        grid: where the nodes are.
        channels: C of the samples' values.
        keep: what is left of the sums at the next mosaic.
    """

    def __init__(self, grid: Grid, channels: int, keep: float) -> None:
        super().__init__(grid, channels)
        self._keep = keep
        self._held, self._held_mass = np.zeros_like(self.images), 0.0
        self._image: Image | None = None

    def hold(self, share: float) -> None:
        """From now on fade towards a share of what there is instead of nothing."""
        self._held, self._held_mass = np.float32(share) * self.images, share * self.mass

    def extend(self, borders: Borders) -> None:
        """Go on with a larger grid."""
        if not any(map(any, borders)):
            return
        self.grid = self.grid.extended(borders)
        wide = ((0, 0), *borders)
        self.images, self._held = np.pad(self.images, wide), np.pad(self._held, wide)
        if self._image is not None:
            self._image = np.pad(self._image, wide, mode="edge")
        self._spare = np.empty((len(self._spare), *self.grid.size), np.float32)

    def advance(self, smoothing: float) -> Mosaic:
        """The mosaic of what was added, a sweep from the one before; the next but one overwrites it."""
        covered = self.covered()
        start = self.solve(smoothing=smoothing, sweeps=COLD).values if self._image is None else self._image
        sweep_and_fade(self.images, start, self._spare, smoothing, self.grid.density, self._keep, self._held)
        self._image, self._spare = self._spare, start
        mosaic = self.mosaic(self._image, covered)
        self.mass = self._keep * self.mass + (1 - self._keep) * self._held_mass
        return mosaic
