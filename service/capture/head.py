"""What every recording of a running service begins with."""

import numpy as np
from numpy.typing import NDArray

from drivers.recording import attachments
from service.capture.played import pack_truth
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.messages.head import Head
from service.versions import software_version


def head_of(configuration: Configuration, rig: Rig, truth: NDArray[np.float32] | None) -> Head:
    """Metadata, calibration, configuration as used and, where there is one, the truth (βH, βW).

    The rig must be open; a file may be begun later, while its camera is lost.
    """
    import tomli_w

    camera = rig.camera.capabilities
    metadata = {
        "rig": configuration.zenoh.prefix,
        "camera_model": camera.model,
        "camera_serial": camera.serial or "",
        "source": camera.source,
        "software_version": software_version(),
    }
    used = tomli_w.dumps(configuration.model_dump(mode="json", exclude_none=True))
    attached = [
        (attachments.CALIBRATION, rig.calibration.to_toml().encode(), "application/toml"),
        (attachments.CONFIGURATION, used.encode(), "application/toml"),
    ]
    if truth is not None:
        attached.append((attachments.TRUTH, pack_truth(truth), "application/octet-stream"))
    return Head(metadata, tuple(attached))
