"""What every recording of a running service begins with."""

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.recording import RecordingHead, recording_head
from drivers.settings import Capabilities
from service.capture.played import pack_truth
from service.config.secrets import without_secrets
from service.config.sections import Configuration


def head_of(
    configuration: Configuration,
    camera: Capabilities,
    calibration: Calibration,
    truth: NDArray[np.float32] | None = None,
    frames_per_burst: int | None = None,
) -> RecordingHead:
    """Metadata, calibration, configuration as used and, where there is one, the truth (βH, βW).

    Args:
        configuration: in force; what is secret in it is hidden.
        camera, calibration: of whoever gives the frames.
        truth: (βH, βW) true distance of the reference view, metres; None = not known.
        frames_per_burst: frames of a whole burst; None = not known.
    """
    import tomli_w

    return recording_head(
        source=camera.source,
        camera_model=camera.model,
        camera_serial=camera.serial,
        rig=configuration.zenoh.prefix,
        frames_per_burst=frames_per_burst,
        calibration=calibration,
        configuration=tomli_w.dumps(
            without_secrets(configuration.model_dump(mode="json", exclude_none=True))
        ),
        truth=None if truth is None else pack_truth(truth),
    )
