"""How much of the package lies compiled on this machine: what a doctor looks at."""

import os
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from numba.core.registry import cpu_target

import solver
from solver.kernels.caching import KernelCache, caches


@dataclass(frozen=True)
class Survey:
    """The kernels on disk.

    Attributes:
        folder: the one that holds all folders in which kernels are looked for and kept; None = there is none.
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
    folders = {files.folder for cache in found for files in cache.files}
    faults = [cache.fault for cache in found if cache.fault is not None]
    return Survey(
        folder=Path(os.path.commonpath(folders)) if folders else None,
        compiled=sum(_is_compiled(cache) for cache in found),
        kernels=len(found),
        fault=faults[0] if faults else None,
    )


def _is_compiled(cache: KernelCache) -> bool:
    processor = cpu_target.target_context.codegen().magic_tuple()
    return any(key[1] == processor for files in cache.files for key in files.index())
