"""What lies beyond the samples: how far away the nearest one is, and values taken from it."""

import cv2
import numpy as np
from numpy.typing import NDArray


def reach(seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(rows, columns): distance in pixels to the nearest pixel that is seen (at least one is)."""
    return np.asarray(cv2.distanceTransform((~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def nearest(values: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The values with each unseen pixel taking that of the nearest seen one (at least one is seen)."""
    if seen.all():
        return values.copy()
    _, labels = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    by_label = np.zeros(int(labels.max()) + 1, values.dtype)
    by_label[labels[seen]] = values[seen]
    return np.asarray(by_label[labels])
