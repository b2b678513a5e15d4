"""Work in a process of somebody else's, such as a Dask worker that a nanny has begun."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.processes.guest import as_guest

ROOT = Path(__file__).parents[2]

FAULTS = """
import resource
import sys

import numpy as np

from service.processes.guest import as_guest


def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(10):
        np.ones(3 << 20, dtype=np.uint8)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


faults()
print(faults(), as_guest(lambda: (faults(), faults())[1]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_memory_that_a_nanny_has_given_back_at_once_is_kept_for_the_next_array() -> None:
    environment = os.environ | {"MALLOC_TRIM_THRESHOLD_": "65536", "PYTHONPATH": str(ROOT)}
    said = subprocess.run(
        [sys.executable, "-c", FAULTS], env=environment, capture_output=True, text=True, check=True
    )
    before, within = map(int, said.stdout.split())
    assert before > 5_000
    assert within < before / 10


def test_the_solver_and_opencv_have_one_thread_each() -> None:
    import cv2
    import numba

    threads = cv2.getNumThreads()
    try:
        assert as_guest(lambda: (numba.get_num_threads(), cv2.getNumThreads())) == (1, 1)
    finally:
        cv2.setNumThreads(threads)


def test_what_goes_wrong_is_raised_where_it_was_asked_for() -> None:
    with pytest.raises(ZeroDivisionError):
        as_guest(lambda: 1 / 0)
