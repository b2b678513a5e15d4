"""Compiled loops (Numba), cached on disk.

Images are padded by `PAD` pixels on every side and rows are walked as views with explicit bounds: negative or
wrapped indices, or a test at the border, would stop the compiler from vectorising. Every loop gives the same
bits for any number of threads: threads share out rows, and sums are taken per row and added in order.
"""

import os

# GNU's OpenMP lets waiting threads spin. On a machine of two cores that also captures and publishes, a
# spinning thread keeps its partner from running: measured 20 times slower under load, no slower without.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from solver.kernels.caching import keep_kernels
from solver.kernels.memory import keep_freed

keep_freed()
keep_kernels()
