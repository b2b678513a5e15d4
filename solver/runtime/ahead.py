"""Kernels compiled ahead, in as many processes as there are processors.

Numba compiles one kernel after the other, each when it is first called, and holds a lock meanwhile that no
second thread gets. What a method will call is known, though: `signatures.json` lists it, made by
`python tests/benchmarks/signatures.py` from what fusions have called. Here other processes compile it and
leave it in the cache, from which the caller's kernels are loaded. A list that has grown old costs time only:
what it lacks is compiled when it is called.
"""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, TextIO

from numba.core import sigutils, types
from numba.core.registry import cpu_target

from solver.runtime.caching import KernelCache

TABLE = Path(__file__).with_name("signatures.json")

_FEW = 4
"""Kernels that are compiled, when they are called, before another process has started."""

_MOST = 8
"""Processes: each takes memory, and none can be done before the longest kernel is."""

_CODE = (
    "import sys; sys.path[:] = {path!r}; from solver.runtime.ahead import serve; serve(sys.stdin, sys.stdout)"
)

_log = logging.getLogger(__name__)

Told = Callable[[int, int], object]


@dataclass(frozen=True, slots=True)
class Listed:
    """A kernel and the types that it is called with.

    Attributes:
        name: module and function.
        arguments: their types, as Numba writes them.
        size: of what it is compiled to, bytes: the larger, the longer it takes.
        methods: that call it, for a burst or in a stream.
    """

    name: str
    arguments: str
    size: int
    methods: tuple[str, ...]

    @property
    def dispatcher(self) -> Any:
        """The kernel itself; its module is imported."""
        module, _, function = self.name.rpartition(".")
        return getattr(import_module(module), function)

    @property
    def types(self) -> tuple[Any, ...]:
        """Numba's types of the arguments."""
        found: tuple[Any, ...] = sigutils.normalize_signature(self.arguments)[0]  # type: ignore[no-untyped-call]
        return found

    @property
    def cache(self) -> KernelCache | None:
        """Where it is kept; None where kernels are not compiled at all, or not kept as this package does."""
        kept = getattr(self.dispatcher, "_cache", None)
        return kept if isinstance(kept, KernelCache) else None

    @property
    def is_missing(self) -> bool:
        """Whether it would be compiled now, and lies nowhere."""
        return self.cache is not None and not self.cache.holds(self.types, cpu_target.target_context)

    def compile(self) -> None:
        """Compile it, or load it from the cache."""
        self.dispatcher.compile(self.types)


@cache
def table() -> tuple[Listed, ...]:
    """All that is listed, what takes longest first."""
    listed = (Listed(**{**row, "methods": tuple(row["methods"])}) for row in json.loads(TABLE.read_text()))
    return tuple(sorted(listed, key=lambda kernel: -kernel.size))


def compile_ahead(method: str, told: Told = lambda *_: None) -> None:
    """Have what the method calls compiled: in the cache on the disk, or here where nothing can be kept.

    Args:
        method: such as `phasor`; of one that is not listed, what all methods call.
        told: called with how many kernels are compiled, and of how many, whenever one is.
    """
    every = {name for kernel in table() for name in kernel.methods}
    wanted = {method} if method in every else every
    missing = [kernel for kernel in table() if wanted <= {*kernel.methods} and kernel.is_missing]
    if len(missing) < _FEW:
        return
    done: SimpleQueue[Listed | None] = SimpleQueue()
    waiting: SimpleQueue[Listed] = SimpleQueue()
    for kernel in missing:
        waiting.put(kernel)
    count = _processes() if all(kernel.cache and kernel.cache.fault is None for kernel in missing) else 0
    for number in range(count):
        Thread(target=_feed, args=(waiting, done), name=f"compiler {number}", daemon=True).start()
    compiled = {kernel.name for kernel in _finished(done, count, len(missing), told)}
    for kernel in missing:
        if kernel.name not in compiled:
            kernel.compile()
            compiled.add(kernel.name)
            told(len(compiled), len(missing))


def _processes() -> int:
    return min(len(os.sched_getaffinity(0)), _MOST)


def _finished(done: "SimpleQueue[Listed | None]", processes: int, total: int, told: Told) -> list[Listed]:
    """What the processes have compiled, once the last of them has said None."""
    kernels: list[Listed] = []
    while processes:
        kernel = done.get()
        if kernel is None:
            processes -= 1
        else:
            kernels.append(kernel)
            told(len(kernels), total)
    return kernels


def _feed(waiting: "SimpleQueue[Listed]", done: "SimpleQueue[Listed | None]") -> None:
    """Give a process of its own one kernel after the other; None at its end."""
    try:
        with subprocess.Popen(
            [sys.executable, "-c", _CODE.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            for kernel in _taken(waiting):
                print(kernel.name, file=process.stdin, flush=True)
                if not process.stdout.readline():
                    _log.info("compiling %s in a process of its own failed", kernel.name)
                    return
                done.put(kernel)
    except OSError as error:
        _log.info("kernels are compiled one after the other: %s", error)
    finally:
        done.put(None)


def _taken(waiting: "SimpleQueue[Listed]") -> Iterator[Listed]:
    with suppress(Empty):
        while True:
            yield waiting.get_nowait()


def serve(requests: TextIO, answers: TextIO) -> None:
    """Compile each kernel that is named on a line, and say so on one; what runs in a process of its own."""
    kernels = {kernel.name: kernel for kernel in table()}
    for line in requests:
        kernels[line.strip()].compile()
        try:
            print(line.strip(), file=answers, flush=True)
        except BrokenPipeError:  # whoever asked has ended meanwhile
            os._exit(0)


def written(arguments: Iterable[Any]) -> str:
    """Types as the list has them, which Numba reads back."""
    return f"({', '.join(_written(kind) for kind in arguments)},)"


def _written(kind: Any) -> str:
    if isinstance(kind, types.Array):
        if not kind.mutable:
            return f"Array({kind.dtype}, {kind.ndim}, {kind.layout!r}, True)"
        axes = [":"] * kind.ndim
        if kind.layout == "C":
            axes[-1] = "::1"
        return f"{_written(kind.dtype)}[{','.join(axes)}]"
    if isinstance(kind, types.UniTuple):
        return f"UniTuple({_written(kind.dtype)}, {kind.count})"
    if isinstance(kind, types.Tuple):
        return f"Tuple(({', '.join(_written(one) for one in kind.types)},))"
    return "boolean" if kind == types.boolean else str(kind)
