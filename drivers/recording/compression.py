"""The MCAP library's writer, which compresses by Zstandard's first level.

Measured on frames (uint16) and maps (float32): as small as by the third, which the library takes and does not
let choose, to 3 %, in a quarter to two thirds of the time.
"""

from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import TYPE_CHECKING

import zstandard

if TYPE_CHECKING:
    from mcap.writer import Writer

_LEVEL = 1


class _FirstLevel:
    """What the writer takes the library of compression for."""

    @staticmethod
    def compress(data: bytes) -> bytes:
        return zstandard.compress(data, _LEVEL)


def fast_writer() -> "type[Writer]":
    """The class, of a copy of its module: other writers of this program compress as they did."""
    spec = find_spec("mcap.writer")
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.__dict__["zstandard"] = _FirstLevel
    found: type[Writer] = module.Writer
    return found
