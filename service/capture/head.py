"""What every recording of a running service begins with."""

import numpy as np
from numpy.typing import NDArray

from drivers.recording import RecordingHead, recording_head
from service.capture.played import pack_truth
from service.capture.rig import Rig
from service.config.sections import Configuration


def head_of(
    configuration: Configuration, rig: Rig, truth: NDArray[np.float32] | None, frames_per_burst: int | None
) -> RecordingHead:
    """Metadata, calibration, configuration as used and, where there is one, the truth (βH, βW).

    The rig must be open; a file may be begun later, while its camera is lost.

    Args:
        frames_per_burst: frames of a whole burst; None = not known.
    """
    import tomli_w

    camera = rig.camera.capabilities
    return recording_head(
        source=camera.source,
        camera_model=camera.model,
        camera_serial=camera.serial,
        rig=configuration.zenoh.prefix,
        frames_per_burst=frames_per_burst,
        calibration=rig.calibration,
        configuration=tomli_w.dumps(configuration.model_dump(mode="json", exclude_none=True)),
        truth=None if truth is None else pack_truth(truth),
    )
