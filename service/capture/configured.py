"""Cameras, stages and rigs as a configuration names them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from drivers.backends import backend_names, make_camera, make_stage
from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock, SystemClock
from drivers.device import Device
from drivers.errors import InitialisationError, RecordingError
from service.capture.motion import Operator
from service.capture.rig import Rig
from service.config.sections import CameraSection, Configuration
from service.errors import ConfigurationError

D = TypeVar("D", bound=Device)


def make_rig(
    configuration: Configuration, clock: Clock | None = None, operator: Operator | None = None
) -> Rig:
    """The configured devices, closed.

    Args:
        operator: who is told what is about to move, and asked whether it may; none = nobody is there.

    Raises:
        ConfigurationError: an unknown backend, an option that it cannot take, or a calibration
            that cannot be read.
        NotAvailableError: a backend's Python library is missing.
    """
    clock = clock if clock is not None else SystemClock()
    section = configuration.camera
    calibration = configured_calibration(section)
    stage = _made(make_stage, "stage", configuration.stage.backend, configuration.stage.options, clock)
    camera = find_camera(section, clock)
    home = configuration.stage.home
    return Rig(camera, stage, clock, section.settings, calibration, home, operator)


def check_options(configuration: Configuration) -> None:
    """Check the backends named and their options, without looking for any device; raises as `make_rig`."""
    clock = SystemClock()
    _made(make_stage, "stage", configuration.stage.backend, configuration.stage.options, clock)
    _made(make_camera, "camera", configuration.camera.backend, configuration.camera.options, clock)
    configured_calibration(configuration.camera)


def configured_calibration(section: CameraSection) -> Calibration | None:
    """The calibration that replaces the camera's own, or None; raises ConfigurationError."""
    if section.calibration is None:
        return None
    try:
        return Calibration.load(section.calibration)
    except RecordingError as error:
        raise ConfigurationError(f"camera.calibration: {error}") from error


def find_camera(section: CameraSection, clock: Clock) -> Camera:
    """The camera of a configuration, closed; `auto` looks for one when it is opened. Raises as `make_rig`."""
    options = dict(section.options)
    if section.backend == "auto" and section.recording is not None:
        options["recording"] = _existing(section.recording)
    return _made(make_camera, "camera", section.backend, options, clock)


def _existing(path: Path) -> Path:
    if not path.exists():
        raise ConfigurationError(f"{path}: there is no such recording (camera.recording)")
    return path


def _made(
    make: Callable[[str, Mapping[str, Any], Clock], D],
    kind: str,
    name: str,
    options: Mapping[str, Any],
    clock: Clock,
) -> D:
    known = backend_names(kind)
    if name not in known:
        raise ConfigurationError(
            f"{kind}.backend = {name!r}: there is no such {kind}; known: {', '.join(known)}"
        )
    try:
        return make(name, options, clock)
    except InitialisationError as error:
        raise ConfigurationError(f"{kind}.options: {error}") from error
