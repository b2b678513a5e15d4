"""Which frames do not fit the others."""

import numpy as np
from numpy.typing import NDArray

from solver.registration.equations import Equations

OVERLAP = 0.3  # share of a frame's pixels that the other frames must cover
FITS = 1.6  # deviations: every frame fits where its residual is that of noise, and a little of edges
STANDS_OUT, SUSPECT = 1.6, 1.25  # times the usual residual: no frame of the scene; perhaps in the wrong place
LEAST = 1.5  # deviations: less is no misfit, however little is usual


def misfits(equations: Equations, others: NDArray[np.bool_], most: float) -> dict[int, str]:
    """Reason by number for those of some frames (N,) whose residual is over `most` times the usual one."""
    found: dict[int, str] = {}
    usual = float(np.median(equations.misfit[others])) if others.any() else 0.0
    for k in np.flatnonzero(others):
        overlap, misfit = equations.overlap[k], equations.misfit[k]
        if overlap < OVERLAP:
            found[int(k)] = (
                f"overlaps the other frames by {100 * overlap:.0f} %; {100 * OVERLAP:.0f} % are needed"
            )
        elif misfit > max(LEAST, most * usual) and not misfit < 1.2 * usual:
            found[int(k)] = (
                f"does not fit the other frames: residual {misfit:.1f} deviations, {usual:.1f} is usual"
            )
    return found
