"""The MCAP library's writer, with a level of Zstandard's that its user chooses.

The library takes the third and does not let choose; see DECISIONS 73 and 83.
"""

from enum import IntEnum
from functools import cache
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import TYPE_CHECKING

import zstandard

if TYPE_CHECKING:
    from mcap.writer import Writer


class Compression(IntEnum):
    """What compressing a recording may cost; the values are Zstandard's levels."""

    SMALL = 1
    """For what is kept."""
    QUICK = -20
    """For what is soon read or deleted: about as fast as copying; noise in floats stays as large as it is."""


class _Zstandard:
    """What the writer takes the library of compression for."""

    def __init__(self, level: int) -> None:
        self._level = level

    def compress(self, data: bytes) -> bytes:
        return zstandard.compress(data, self._level)


@cache
def writer_class(compression: Compression) -> "type[Writer]":
    """The class, of a copy of its module: other writers of this program compress as they did."""
    spec = find_spec("mcap.writer")
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.__dict__["zstandard"] = _Zstandard(compression)
    found: type[Writer] = module.Writer
    return found
