"""How much of the package lies compiled on this machine: what a doctor looks at."""

import os
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from numba.core.registry import cpu_target

import solver
from solver.runtime.caching import KernelCache, caches


@dataclass(frozen=True)
class Survey:
    """The kernels on disk.

    Attributes:
        folder: the one that holds all compiled kernels or, where there are none yet, will hold them; None =
            kernels are not compiled at all.
        compiled: kernels that lie there for this processor and these sources.
        kernels: those that the package has; each method needs only some of them.
        fault: why what is compiled from now on cannot be kept; None where it can.
    """

    folder: Path | None
    compiled: int
    kernels: int
    fault: str | None


def survey() -> Survey:
    """Look at the cache of every kernel; a folder for them is made where it is missing, as at every start."""
    for module in walk_packages(solver.__path__, "solver."):
        import_module(module.name)
    found = caches()
    lying = {cache: _folder(cache) for cache in found}
    folders = {folder for folder in lying.values() if folder is not None}
    folders = folders or {cache.files[-1].folder for cache in found}
    return Survey(
        folder=Path(os.path.commonpath(folders)) if folders else None,
        compiled=sum(folder is not None for folder in lying.values()),
        kernels=len(found),
        fault=next((cache.fault for cache in found if cache.fault is not None), None),
    )


def _folder(cache: KernelCache) -> Path | None:
    """Where the kernel lies compiled for this processor."""
    processor = cpu_target.target_context.codegen().magic_tuple()
    for files in cache.files:
        if any(key[1] == processor for key in files.index()):
            return files.folder
    return None
