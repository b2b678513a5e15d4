"""List what the fusion compiles: `python tests/benchmarks/signatures.py`.

It writes `solver/runtime/signatures.json`: for each method a burst and a stream are fused, of the small scene
that a service starts with and of the bundled recording (for `area` also without its amplitude, as `auto`
takes it for cameras that give none), each method in a process of its own; the kernels that were called are
listed with the types of their arguments. Run it after a kernel is added, renamed or given other arguments: a
test asks for it.
"""

import gc
import json
import multiprocessing
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from numba.core.registry import cpu_target  # noqa: E402

from solver.runtime.ahead import TABLE, written  # noqa: E402

METHODS = "lidarboost", "area", "phasor"

Row = dict[str, Any]


def called(method: str) -> list[Row]:
    """The kernels that a method calls, in this process, which has called none yet."""
    from numba.core.dispatcher import Dispatcher

    from solver.runtime.caching import KernelCache

    fuse_all(method)
    rows = []
    for dispatcher in [one for one in gc.get_objects() if isinstance(one, Dispatcher)]:
        function, kept = dispatcher.py_func, dispatcher._cache
        if not isinstance(kept, KernelCache) or not dispatcher.overloads:
            continue
        for arguments in dispatcher.overloads:
            name = f"{function.__module__}.{function.__name__}"
            rows.append({"name": name, "arguments": written(arguments), "size": size_of(kept, arguments)})
    return rows


def size_of(kept: Any, arguments: tuple[Any, ...]) -> int:
    """Bytes that the compiled kernel takes on the disk."""
    key = kept._index_key(arguments, cpu_target.target_context.codegen())
    found = [files.folder / files.index()[key] for files in kept.files if key in files.index()]
    return found[0].stat().st_size


def fuse_all(method: str) -> None:
    """What a service does with a method: the small scene, then a recording's burst and its frames."""
    from drivers.recording import open_recording
    from service.config.sections import FusionSection
    from service.fusion.answering import fuse_small_scenes
    from service.fusion.fuse import fuse_burst
    from service.fusion.job import FrameJob, WarmUp
    from service.fusion.streams import Stream
    from service.messages.burst import Burst

    settings = FusionSection.model_validate({"method": method})
    recording = open_recording(ROOT / "recordings" / "wedges.mcap")
    frames, calibration = tuple(recording.frames())[:15], recording.calibration
    fuse_small_scenes(WarmUp(settings, 4))
    fuse_burst(Burst(0, frames, calibration, len(frames)), settings)
    if method == "area":
        dim = tuple(replace(frame, amplitude=None) for frame in frames)
        fuse_burst(Burst(0, dim, calibration, len(dim)), settings)
    jobs = [FrameJob(frame, calibration, settings, 8, 1, number) for number, frame in enumerate(frames)]
    pushed = Stream(jobs[0])
    for job in jobs:
        pushed.push(job)


def listed() -> list[Row]:
    """All kernels that some method calls, by name."""
    # An interpreter of its own for each: one that has called kernels would list them for the next. Two
    # rounds: what is compiled, and not loaded, comes with the kernels that it is made of.
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        list(pool.imap(called, METHODS))
        found = list(pool.imap(called, METHODS))
    kernels: dict[tuple[str, str], Row] = {}
    for method, rows in zip(METHODS, found, strict=True):
        for row in rows:
            kernel = kernels.setdefault((row["name"], row["arguments"]), {**row, "methods": []})
            kernel["methods"].append(method)
    return [kernels[name] for name in sorted(kernels)]


def main() -> int:
    rows = listed()
    TABLE.write_text("[\n" + ",\n".join(f"  {json.dumps(row)}" for row in rows) + "\n]\n")
    print(f"{len(rows)} kernels written to {TABLE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
