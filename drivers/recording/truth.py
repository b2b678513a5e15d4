"""The truth of a simulated recording."""

from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.recording.attachments import TRUTH


def unpack_truth(content: bytes, path: Path) -> NDArray[np.float32]:
    """(βH, βW) true distance, metres, of the attachment `truth.npz` of a file.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        with np.load(BytesIO(content), allow_pickle=False) as arrays:
            truth = np.asarray(arrays["distance"], dtype=np.float32)
        if truth.ndim != 2 or not truth.size:
            raise ValueError(f"it has the shape {truth.shape}")
    except Exception as error:  # a damaged archive fails in zipfile, zlib, NumPy or for want of memory
        reason = str(error) or type(error).__name__
        raise RecordingError(
            f"{path}: {TRUTH} cannot be read ({reason}); expected the array `distance`"
        ) from error
    return truth
