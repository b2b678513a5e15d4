"""How many threads the solver may use, where several of it are at work."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba


@contextmanager
def solver_threads(count: int) -> Iterator[None]:
    """Let the solver of this thread use so many, or all there are where they are fewer."""
    before = numba.get_num_threads()
    numba.set_num_threads(min(count, before))
    try:
        yield
    finally:
        numba.set_num_threads(before)
