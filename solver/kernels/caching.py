"""Numba's cache on disk, told of every file that a kernel is compiled from.

Numba keeps what it compiled for as long as the kernel's own file stays as it is. Functions and constants of
other files are compiled in too, and after an upgrade of those alone it would go on with the old ones. So the
stamp of each kernel of this package also holds the sources that its file imports from the package by name.
Where the cache lies is still Numba's choice, or that of its environment variables.
"""

import hashlib
import re
import sys
from contextlib import suppress
from functools import cache
from typing import Any

from numba.core import caching

_IMPORT = re.compile(rb"\nfrom (solver\.[.\w]+) import")


@cache
def digest(module: str) -> bytes:
    """Of the source of an imported module and of those that it imports from the package."""
    found = sys.modules[module]
    source = found.__loader__.get_data(found.__file__)  # type: ignore[union-attr]
    total = hashlib.sha256(source)
    for name in _IMPORT.findall(source):
        total.update(digest(name.decode()))
    return total.digest()


class _Locator:
    """Finds a kernel's place as Numba does, and adds to its stamp."""

    @staticmethod
    def from_function(function: Any, file: str) -> Any:
        if not function.__module__.startswith("solver."):
            return None
        places = (kind.from_function(function, file) for kind in _kinds() if kind is not _Locator)
        place = next((place for place in places if place is not None), None)
        if place is not None:
            stamp = place.get_source_stamp(), digest(function.__module__)
            place.get_source_stamp = lambda: stamp
        return place


def _kinds() -> list[Any]:
    kinds: list[Any] = caching.FunctionCache._impl_class._locator_classes
    return kinds


def look_at_all_sources() -> None:
    """From now on, for the package's kernels; a Numba that has no such list looks at their own files."""
    with suppress(AttributeError):
        _kinds().insert(0, _Locator)
