"""Compiled loops (Numba), cached on disk.

Images are padded by `PAD` pixels on every side and rows are walked as views with explicit bounds: negative or
wrapped indices, or a test at the border, would stop the compiler from vectorising. Every loop gives the same
bits for any number of threads: threads share out rows, and sums are taken per row and added in order.
"""

import logging

from numba.core import config

import solver.runtime  # noqa: F401  it keeps what is compiled here

if config.DISABLE_JIT:  # type: ignore[attr-defined]
    logging.getLogger(__name__).warning(
        "nothing is compiled (NUMBA_DISABLE_JIT is set): a fusion takes some hundred times as long"
    )
