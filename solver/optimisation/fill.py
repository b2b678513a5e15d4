"""What lies beyond the samples: how far away the nearest one is, and values taken from it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import filling as kernels

_SWEEPS, _OVER = 60, 1.85
"""Enough for gaps of 40 pixels, twice the default reach of filling at ×4, to about a per cent."""


def reach(seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(rows, columns): distance in pixels to the nearest pixel that is seen (at least one is)."""
    return np.asarray(cv2.distanceTransform(_unseen(seen), cv2.DIST_L2, cv2.DIST_MASK_5))


def smoothed(values: NDArray[np.float32], weight: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """The mean of the samples around each pixel; beyond them, that of the nearest pixel that has one.

    Args:
        values: the mean of the samples on each pixel; weight: their weight, 0 where there are none.
        factor: β; the mean is Gaussian, of deviation 0.4 low-resolution pixels, which bridges the gaps
            between the samples of a burst.
    """
    deviation = 0.4 * factor
    total, share = (
        np.asarray(cv2.GaussianBlur(image, (0, 0), deviation, borderType=cv2.BORDER_CONSTANT), np.float32)
        for image in (values * weight, weight)
    )
    # The second is for factors so large that a lone sample's weight thins out to less than the first.
    least = min(1e-3 * float(weight.max()), 0.1 * float(share.max()))
    return np.asarray(ratio(total[None], share, least)[0], np.float32)


def ratio(totals: NDArray[np.floating], share: NDArray[np.floating], least: float) -> NDArray[np.floating]:
    """totals (C, rows, columns) / share, in place; where that is not over `least`, the nearest quotient."""
    known = np.empty(share.shape, np.bool_)
    for total in totals:
        kernels.divide(total, share, share.dtype.type(least), known)
    if not known.all():
        labels = _labelled(known)[1]
        for total in totals:
            kernels.take(labels, known, total)
    return totals


def smooth(
    values: NDArray[np.float32], known: NDArray[np.bool_], most: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The values with the unknown pixels bridged smoothly, and the distance to the nearest known pixel.

    They are harmonic, starting from the nearest ones; further than `most` pixels away they stay these.
    """
    away, labels = _labelled(known)
    filled = values.copy()
    kernels.take(labels, known, filled)
    rows, columns = np.divmod(np.flatnonzero(~known & (away <= most)), known.shape[1])
    # As on a chessboard, the black ones first: no pixel then waits for the one before it.
    order = np.argsort((rows + columns) % 2, kind="stable")
    kernels.relax(filled, rows[order], columns[order], _SWEEPS, _OVER)
    return filled, away


def nearest(values: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The values with each unseen pixel taking that of the nearest seen one (at least one is seen)."""
    filled = values.copy()
    if not seen.all():
        kernels.take(_labelled(seen)[1], seen, filled)
    return filled


def _labelled(seen: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """(rows, columns) twice: see `reach`; a number for each seen pixel, and at unseen ones the nearest's."""
    away, labels = cv2.distanceTransformWithLabels(
        _unseen(seen), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    return np.asarray(away, np.float32), np.asarray(labels)


def _unseen(seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return (~seen).view(np.uint8)
