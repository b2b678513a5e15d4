"""Live depth superresolution for time-of-flight cameras on a rotating rig.

```python
import lidarboost

recording = lidarboost.open_recording("recordings/wedges.mcap")
frames = list(recording.frames())
fused = lidarboost.fuse([frame.distance for frame in frames], [frame.signal for frame in frames])

with lidarboost.Client() as rig:  # of a running `lidarboost run`
    depth = rig.latest("fused/depth")
```

Everything is imported when it is first used, so that `import lidarboost` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivers import Camera
    from drivers.recording import open_recording
    from service.errors import CommandError
    from service.wire.client import Client
    from solver import Fused, FusionOptions, SlidingFusion, fuse

__all__ = [
    "Client",
    "CommandError",
    "Fused",
    "FusionOptions",
    "SlidingFusion",
    "fuse",
    "open_camera",
    "open_recording",
]

_HOMES = {
    "Client": "service.wire.client",
    "CommandError": "service.errors",
    "Fused": "solver",
    "FusionOptions": "solver",
    "SlidingFusion": "solver",
    "fuse": "solver",
    "open_recording": "drivers.recording",
}


def open_camera(name: str = "auto", **options: Any) -> "Camera":
    """An open camera; close it, or use it in a `with` statement.

    Args:
        name: the backend; `auto` = the first real camera found, else the recording named by the option
            `recording`.
        options: of the backend.

    Raises:
        NotAvailableError: unknown backend, missing library, or no camera found.
        InitialisationError: an option that the backend does not know or cannot take, or a camera that does
            not answer as it should.
        RecordingError: the recording cannot be read.
    """
    from drivers import make_camera

    camera = make_camera(name, options)
    camera.open()
    return camera


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'lidarboost' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)


if __name__ == "__main__":
    from service.cli import main

    main()
