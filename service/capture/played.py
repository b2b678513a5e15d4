"""What is known beyond the frames: the recording that is played, and the truth where there is one."""

from collections.abc import Callable
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


def truth_finder(camera: Camera, upsampling: int) -> Callable[[], NDArray[np.float32] | None]:
    """What gives (βH, βW) true distance of the reference view, metres: recorded, simulated, or None.

    Any thread may call it, whatever becomes of the camera. It takes its time where that is simulated.
    """
    recording = recording_of(camera)
    if recording is not None:
        return lambda: recording.truth
    if camera.capabilities.source == "simulation":
        render = camera.truth_renderer(upsampling)  # type: ignore[attr-defined]
        return lambda: np.asarray(render().distance, dtype=np.float32)
    return lambda: None


def pack_truth(truth: NDArray[np.float32]) -> bytes:
    """The content of the attachment `truth.npz`."""
    content = BytesIO()
    np.savez_compressed(content, distance=truth)
    return content.getvalue()
