"""Depth superresolution from slightly rotated time-of-flight frames: arrays in, arrays out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from solver.errors import FusionError, FusionInputError, FusionWarning, RegistrationError
from solver.options import NEIGHBOURHOOD, Footprint, FusionOptions, Method
from solver.result import Fused, Progress, Report, Seconds

if TYPE_CHECKING:
    from solver.fusion import fuse
    from solver.stream.sliding import SlidingFusion
    from solver.warming import warm_up

__all__ = [
    "NEIGHBOURHOOD",
    "Footprint",
    "Fused",
    "FusionError",
    "FusionInputError",
    "FusionOptions",
    "FusionWarning",
    "Method",
    "Progress",
    "RegistrationError",
    "Report",
    "Seconds",
    "SlidingFusion",
    "fuse",
    "warm_up",
]

# Imported on use: they need Numba, which takes longer to import than most commands to run.
_LAZY = {
    "SlidingFusion": "solver.stream.sliding",
    "fuse": "solver.fusion",
    "warm_up": "solver.warming",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value
