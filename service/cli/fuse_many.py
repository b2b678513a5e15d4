"""Many recordings to be fused: one bar, and what became of each."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from service.errors import ClusterLostError

if TYPE_CHECKING:
    from service.jobs.task import FileResult, FuseTask


def fuse_many(
    tasks: Sequence["FuseTask"], workers: int | None, cluster: str | None, *, quiet: bool
) -> list["FileResult"]:
    """Fuse in a pool of processes, or on a cluster; what became of each, in the order of the tasks.

    Raises:
        ClusterError: the cluster cannot be used.
    """
    from drivers.names import shown
    from service.jobs.task import failed

    done: dict[str, FileResult] = {}
    lost = None
    with _directory(tasks[0].directory), _bar(len(tasks)) as advance:
        try:
            for result in _results(tasks, workers, cluster):
                done[result.input] = result
                tell(result, quiet=quiet)
                advance()
        except ClusterLostError as error:
            lost = error
    if lost is not None:
        left = [task for task in tasks if shown(task.path) not in done]
        again = "" if tasks[0].directory is None else ": the same command goes on from there"
        print(f"error: {lost}; {len(left)} of {len(tasks)} recordings are not fused{again}", file=sys.stderr)
        done |= {shown(task.path): failed(task, str(lost)) for task in left}
    print(_account(list(done.values())), file=sys.stderr)
    return [done[shown(task.path)] for task in tasks]


def tell(result: "FileResult", *, quiet: bool) -> None:
    """Results on standard output, what was lost on standard error."""
    from service.messages.summary import describe

    if result.error is not None:
        print("error:", result.error, file=sys.stderr)
    if not quiet:
        for burst in result.bursts:
            print(f"{Path(result.input).name}: {describe(burst)}")
        if result.output is not None:
            print(f"{'was there already:' if result.resumed else 'wrote'} {result.output}", flush=True)
    for what in result.lost:
        print(f"lost: {result.input}: {what}", file=sys.stderr)


def _results(tasks: Sequence["FuseTask"], workers: int | None, cluster: str | None) -> Iterator["FileResult"]:
    if cluster is not None:
        from service.jobs.cluster import fuse_on_cluster

        return fuse_on_cluster(tasks, cluster)
    from service.jobs.pool import cores, fuse_in_pool

    return fuse_in_pool(tasks, workers or cores())


def _account(results: Sequence["FileResult"]) -> str:
    failures = sum(result.error is not None for result in results)
    before = sum(result.resumed for result in results)
    damaged = sum(result.damage is not None for result in results)
    in_part = sum(bool(result.failures) for result in results)
    parts = [f"{len(results) - failures - before} fused"]
    parts += [f"{before} fused before"] if before else []
    parts += [f"{damaged} damaged"] if damaged else []
    parts += [f"{in_part} in part"] if in_part else []
    parts += [f"{failures} failed"] if failures else []
    return f"{len(results)} recordings: {', '.join(parts)}"


@contextmanager
def _directory(path: Path | None) -> Iterator[None]:
    """Make it for all of them; one that was made here and is empty in the end goes again."""
    from service.files import made_directory

    existed = path is None or path.exists()
    with nullcontext() if path is None else made_directory(path):
        yield
    if path is not None and not existed:
        with suppress(OSError):
            path.rmdir()


@contextmanager
def _bar(total: int) -> Iterator[Callable[[], None]]:
    with ExitStack() as stack:
        if not sys.stderr.isatty():
            yield lambda: None
            return
        from rich.progress import TimeRemainingColumn

        from service.cli.terminal import bar

        shown = stack.enter_context(bar(TimeRemainingColumn(), "recordings"))
        task = shown.add_task("fusing", total=total)
        yield lambda: shown.advance(task)
