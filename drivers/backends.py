"""Which cameras and stages there are; each is imported only when it is used."""

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, TypeVar

from pydantic import ValidationError

from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import Device
from drivers.documents import told
from drivers.errors import InitialisationError, NotAvailableError
from drivers.stage import Stage

CAMERAS: dict[str, tuple[str, str]] = {
    "auto": ("drivers.auto", "AutoCamera"),
    "mesasr": ("drivers.mesasr", "MesaCamera"),
    "replay": ("drivers.replay", "ReplayCamera"),
    "simulated": ("drivers.simulated", "SimulatedCamera"),
    "usb": ("drivers.usb", "UsbCamera"),
    "zenoh": ("drivers.remote", "ZenohCamera"),
}
"""Camera backends: name → (module, class). Others come by the entry point group `lidarboost.cameras`."""

STAGES: dict[str, tuple[str, str]] = {
    "dynamixel": ("drivers.stages.dynamixel", "DynamixelStage"),
    "grbl": ("drivers.stages.grbl", "GrblStage"),
    "none": ("drivers.fixed", "FixedStage"),
    "ptu": ("drivers.stages.ptu", "PtuStage"),
    "simulated": ("drivers.simulated", "SimulatedStage"),
}
"""Stage backends: name → (module, class). Others come by the entry point group `lidarboost.stages`."""

D = TypeVar("D", bound=Device)


def camera_class(name: str) -> type[Camera]:
    """The class of a camera backend; raises `NotAvailableError` where it is unknown or cannot be imported."""
    return _backend(name, CAMERAS, "camera", Camera)  # type: ignore[type-abstract]


def stage_class(name: str) -> type[Stage]:
    """The class of a stage backend; raises `NotAvailableError` where it is unknown or cannot be imported."""
    return _backend(name, STAGES, "stage", Stage)  # type: ignore[type-abstract]


def make_camera(name: str, options: Mapping[str, Any] | None = None, clock: Clock | None = None) -> Camera:
    """A closed camera of the named backend.

    Raises:
        NotAvailableError: unknown backend, or its library is missing.
        InitialisationError: options that it does not know or cannot take.
    """
    return _make(camera_class(name), name, options, clock)


def make_stage(name: str, options: Mapping[str, Any] | None = None, clock: Clock | None = None) -> Stage:
    """A closed stage of the named backend; raises as `make_camera`."""
    return _make(stage_class(name), name, options, clock)


def backend_names(kind: str) -> list[str]:
    """Names of all backends of a kind (`camera` or `stage`), sorted."""
    table = CAMERAS if kind == "camera" else STAGES
    return sorted({*table, *(point.name for point in entry_points(group=f"lidarboost.{kind}s"))})


def _backend(name: str, table: Mapping[str, tuple[str, str]], kind: str, base: type[D]) -> type[D]:
    try:
        if name in table:
            module, attribute = table[name]
            found = getattr(import_module(module), attribute)
        else:
            points = entry_points(group=f"lidarboost.{kind}s", name=name)
            if not points:
                raise NotAvailableError(
                    f"no {kind} backend is called {name!r}; there are: {', '.join(backend_names(kind))}"
                )
            found = next(iter(points)).load()
    except (ImportError, AttributeError) as error:
        raise NotAvailableError(f"{kind} backend {name!r} cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, base)):
        raise NotAvailableError(f"{kind} backend {name!r} is not a {base.__name__}: {found!r}")
    return found


def _make(kind: type[D], name: str, options: Mapping[str, Any] | None, clock: Clock | None) -> D:
    try:
        checked = kind.Options.model_validate(dict(options or {}))
    except ValidationError as error:
        unknown = any(fault["type"] == "extra_forbidden" for fault in error.errors(include_url=False))
        known = f" (it knows: {', '.join(kind.Options.model_fields) or 'none'})" if unknown else ""
        raise InitialisationError(f"options of backend {name!r}: {told(error)}{known}") from error
    return kind(checked, clock)
