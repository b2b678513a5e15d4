"""A fusion gives the same map however its process came to be, and where nothing is compiled."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]

FUSE = """
import json, multiprocessing, sys
import numpy as np
from solver import FusionOptions, fuse

def fused(method):
    random = np.random.default_rng(0)
    _, columns = np.mgrid[:10, :12]
    distance = (2 + 0.4 * (columns > 6) + random.normal(0, 0.005, (3, 10, 12))).astype(np.float32)
    shifts = None if method == "nearest" else np.array([[0, 0], [0.4, 0.3], [-0.3, 0.5]])  # registered
    options = FusionOptions(method=method, upsampling=2)
    light = np.full(distance.shape, 1000, np.float32)
    return fuse(distance, light, options=options, shifts=shifts, ambiguity_range=7.5).distance.tolist()

if __name__ == "__main__":
    how, methods = sys.argv[1], sys.argv[2:]
    if how == "here":
        found = [fused(method) for method in methods]
    else:
        before = [fused(method) for method in methods] if how == "fork" else []
        with multiprocessing.get_context(how).Pool(1) as pool:
            found = pool.map(fused, methods)
        assert not before or before == found
    print(json.dumps(found))
"""


def run(folder: Path, how: str, *methods: str, **environment: str) -> tuple[list[np.ndarray], str]:
    """The maps that a process of its own prints, and what it says on the way."""
    script = folder / "script.py"
    script.write_text(FUSE)
    said = subprocess.run(
        [sys.executable, str(script), how, *methods],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=True,
        timeout=900,
    )
    return [np.array(one) for one in json.loads(said.stdout)], said.stderr


@pytest.mark.timeout(600)
@pytest.mark.parametrize("how", ["fork", "spawn"])
def test_a_process_that_was_forked_or_spawned_fuses_alike(tmp_path: Path, how: str) -> None:
    (here,), _ = run(tmp_path, "here", "lidarboost")
    (there,), _ = run(tmp_path, how, "lidarboost")
    np.testing.assert_array_equal(here, there)


FINE = """
import numpy as np
from solver import FusionOptions, fuse

distance, light = np.full((1, 3, 3), 2, np.float32), np.full((1, 3, 3), 1000, np.float32)
for factor in 1, 5:
    options = FusionOptions(method="phasor", upsampling=factor, max_iterations=1)
    fuse(distance, light, options=options, ambiguity_range=7.5)
"""


def test_no_row_of_taps_reads_beyond_an_image(tmp_path: Path) -> None:
    """Compiled, what lies there may be NaN, of which zero times is one; plain, it is an error.

    Taps are walked by four: of one or five of them, three are zero and read furthest.
    """
    script = tmp_path / "script.py"
    script.write_text(FINE)
    subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
        check=True,
        timeout=300,
    )


@pytest.mark.slow
@pytest.mark.timeout(1000)
def test_where_compiling_is_switched_off_the_map_is_the_same_and_it_is_said(tmp_path: Path) -> None:
    methods = "nearest", "shift-and-add", "ibsr", "mrf", "lidarboost", "area", "phasor"
    compiled, said = run(tmp_path, "here", *methods)
    assert "NUMBA_DISABLE_JIT" not in said
    plain, said = run(tmp_path, "here", *methods, NUMBA_DISABLE_JIT="1")
    assert said.count("nothing is compiled (NUMBA_DISABLE_JIT is set)") == 1
    for one, other in zip(compiled, plain, strict=True):
        # Sums of another order; a pixel on an edge, which `phasor` may decide either way, enlarges last bits.
        assert np.mean(~(np.abs(one - other) < 1e-3)) < 0.02
        assert np.median(np.abs(one - other)) < 1e-5
