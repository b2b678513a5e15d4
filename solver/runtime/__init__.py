"""How kernels run: compiled, kept on disk, shared by threads, with memory that is kept for the next image."""

import os

# GNU's OpenMP lets waiting threads spin. On a machine of two cores that also captures and publishes, a
# spinning thread keeps its partner from running.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from solver.runtime.caching import keep_kernels
from solver.runtime.memory import keep_freed

keep_freed()
keep_kernels()
