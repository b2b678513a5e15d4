"""Compiled kernels, kept on disk where Numba keeps them, in a way that matters to nothing but the time taken.

Numba's own cache ends a program that finds a file torn or a folder that cannot be written, and it looks only
at the kernel's own source. Here any fault in reading has the kernel compiled anew; any fault in writing is
told once; and the stamp of a kernel holds the sources that its file imports from the package by name, since
functions and constants of other files are compiled in too. Where the cache lies is still Numba's choice, or
that of its environment variables; kernels are also read from folders before it that cannot be written.
"""

import hashlib
import logging
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching, config, dispatcher

from solver.runtime.files import KernelFiles, fault_in_writing

_IMPORT = re.compile(rb"\nfrom (solver\.[.\w]+) import")

_log = logging.getLogger(__name__)
_tell: Any = caching._cache_log
"""Says what NUMBA_DEBUG_CACHE asks for."""


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
    """Stands for all of a kernel's folders; only the last can be written, if any can.

    It has the methods that Numba calls.
    """

    def __init__(self, function: Any, file: str) -> None:
        self.faults: list[str] = []
        self.folders: list[Path] = []
        self._line = function.__code__.co_firstlineno
        for folder in _choices(function, file):
            self.folders.append(folder)
            fault = fault_in_writing(folder)
            if fault is None:
                break
            self.faults.append(fault)

    @classmethod
    def from_function(cls, function: Any, file: str) -> "_Locator":
        return cls(function, file)

    def get_cache_path(self) -> str:
        return str(self.folders[-1])

    def get_source_stamp(self) -> None:
        """None: `KernelFiles` are given a stamp of their own."""

    def get_disambiguator(self) -> str:
        return str(self._line)

    @property
    def fault(self) -> str | None:
        """Why no folder can be written; None where one can."""
        return None if len(self.faults) < len(self.folders) else "; ".join(self.faults)

    def ensure_cache_path(self) -> None:
        if self.fault is not None:
            raise OSError(self.fault)


def _choices(function: Any, file: str) -> Iterator[Path]:
    """Where Numba would keep a kernel, its first choice first."""
    kinds: list[Any] = [caching.InTreeCacheLocator, caching.UserWideCacheLocator]
    if config.CACHE_DIR:  # type: ignore[attr-defined]
        kinds.insert(0, caching.UserProvidedCacheLocator)
    for kind in kinds:
        folder = Path(kind(function, file).get_cache_path())
        if folder.is_absolute() or kind is caching.UserProvidedCacheLocator:  # a user without a home has none
            yield folder.absolute()


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes: Any = (_Locator,)  # Numba looks at NUMBA_CACHE_LOCATOR_CLASSES first


class _Folders:
    """A kernel's files in all its folders, with the methods that Numba calls."""

    def __init__(self, files: list[KernelFiles]) -> None:
        self.files = files

    def load(self, key: object) -> Any:
        """From the first folder that has it."""
        for files in self.files:
            try:
                found = files.load(key)
            except Exception as fault:
                _log.info("a compiled kernel cannot be read: %s", fault)
                continue
            if found is not None:
                _tell("[cache] data loaded from %r", str(files.folder))
                return found
        return None

    def save(self, key: object, data: Any) -> None:
        self.files[-1].save(key, data)
        _tell("[cache] data saved to %r", str(self.files[-1].folder))

    def flush(self) -> None:
        self.files[-1].clear()


class KernelCache(caching.FunctionCache):
    """Numba's cache of one kernel; none of its faults reaches the caller.

    Attributes:
        files: the kernel's by folder; what is compiled goes to the last.
        fault: why nothing can be written there; None where it can.
    """

    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        locator, name = self._impl.locator, self._impl.filename_base
        folders = locator.folders if isinstance(locator, _Locator) else [Path(locator.get_cache_path())]
        stamp = numba.__version__, digest(function.__module__)
        self.files = [KernelFiles(folder, name, stamp) for folder in folders]
        self.fault = locator.fault if isinstance(locator, _Locator) else None
        self._cache_file: Any = _Folders(self.files)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception as fault:  # whatever linking what was read can lead to
            _log.info("a compiled kernel cannot be used: %s", fault)
            return None

    def holds(self, arguments: tuple[Any, ...], target_context: Any) -> bool:
        """Whether it lies compiled for these types of arguments, as far as its index says."""
        key = self._index_key(arguments, target_context.codegen())  # type: ignore[no-untyped-call]
        return any(key in files.index() for files in self.files)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel, if that is possible."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception as fault:  # a full disk, a folder that cannot be written, what cannot be pickled
            _warn_once(fault)


_caches: list[KernelCache] = []
_has_warned = False


def keep_kernels() -> None:
    """From now on the package's kernels (`njit(cache=True)`) are kept as this module does it."""
    dispatcher.FunctionCache = _cache_of  # type: ignore[attr-defined]


def _cache_of(function: Any) -> Any:
    if not function.__module__.startswith("solver."):
        return caching.FunctionCache(function)  # type: ignore[no-untyped-call]
    try:
        _caches.append(KernelCache(function))
    except Exception as fault:  # a Numba that is built otherwise, or variables that name no locator
        _warn_once(fault)
        return caching.NullCache()
    return _caches[-1]


def caches() -> list[KernelCache]:
    """Of every kernel imported so far."""
    return list(_caches)


def _warn_once(fault: Exception) -> None:
    global _has_warned
    if not _has_warned:
        _has_warned = True
        where = (
            f"{fault.filename}: {fault.strerror}" if isinstance(fault, OSError) and fault.filename else fault
        )
        _log.warning(
            "compiled kernels cannot be kept (%s): every start compiles them anew, which takes minutes; name "
            "a folder of your own in NUMBA_CACHE_DIR",
            where,
        )
