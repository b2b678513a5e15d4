"""What is known beyond the frames: the recording that is played, and the truth where there is one."""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from drivers.auto import AutoCamera
from drivers.camera import Camera
from drivers.recording import Recording
from drivers.replay import ReplayCamera


def replayed(camera: Camera) -> ReplayCamera | None:
    """The camera behind an open one that plays a recording; None where none is played."""
    found = camera.found if isinstance(camera, AutoCamera) else camera
    return found if isinstance(found, ReplayCamera) else None


def recording_of(camera: Camera) -> Recording | None:
    """The recording that an open camera plays, or None."""
    played = replayed(camera)
    return None if played is None else played.recording


def truth_of(camera: Camera, upsampling: int) -> NDArray[np.float32] | None:
    """(βH, βW) true distance of the reference view, metres: of the recording, of the simulation, or None."""
    recording = recording_of(camera)
    if recording is not None:
        return recording.truth
    if camera.capabilities.source == "simulation":
        return np.asarray(camera.truth(upsampling).distance, dtype=np.float32)  # type: ignore[attr-defined]
    return None


def pack_truth(truth: NDArray[np.float32]) -> bytes:
    """The content of the attachment `truth.npz`."""
    content = BytesIO()
    np.savez_compressed(content, distance=truth)
    return content.getvalue()
