"""How fast every fusion method is: `python tests/benchmarks/fusion.py [--quick] [--json FILE]`.

One table: time, iterations, gap and peak memory of each method by size, N and β, and the ratio to what the
memory bandwidth measured in the same run allows; then growth with pixels and with N; then CVXPY with Clarabel
and with SCS on the LidarBoost paper's patches of 20 × 20 fused pixels with two pixels of overlap. Needs the
extra `bench`. Run it on an idle machine; every time is the least of three, after one run to warm up.
"""

import argparse
import ctypes
import time
import warnings
from dataclasses import asdict, dataclass
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numba
import numpy as np
from patches import compare_patches
from stored import store

from solver import Fused, FusionOptions, FusionWarning, fuse
from solver.evaluation import DepthMap, Trial, make_trial, procedural_object
from solver.options import Method

SIZES = ((50, 50), (64, 106), (89, 126), (144, 176))  # rows × columns; the paper's crops and a full frame
FRAMES = (10, 15, 30)
FACTORS = (2, 4, 8)
METHODS: tuple[Method, ...] = (
    "nearest",
    "bicubic",
    "shift-and-add",
    "ibsr",
    "mrf",
    "lidarboost",
    "area",
    "phasor",
)
AMBIGUITY_RANGE = 400.0  # the object spans 0..182

# Bytes that one iteration moves per fused pixel, float32, each array once. By channel: map, last step and
# direction read and written; the map that a diagonal operator draws to read, or with a footprint the data's
# gradient and the products of direction and step read and written, and two slopes read. By pixel: radius and
# curvature, with a footprint five stencil images and six bytes of ties. `phasor` by round of conjugate
# gradients: eight strengths of two bytes, five stencil images, and by channel the phasors and the diagonal
# read, direction, its product, residual and step read and written.
TRAFFIC = {
    "lidarboost": 4 * (6 + 1 + 2),
    "area": 4 * (6 + 6 + 2 + 2 + 5 + 1.5),
    "phasor": 4 * (4 + 5 + 2 * (2 + 8)),
}


@dataclass(frozen=True)
class Row:
    """One method on one burst; seconds of the solve, bytes of peak memory above what was held before."""

    method: str
    rows: int
    columns: int
    frames: int
    upsampling: int
    registration: float
    solve: float
    iterations: int
    gap: float | None
    converged: bool
    peak: int
    bandwidth_ratio: float | None


@cache
def burst(rows: int, columns: int, frames: int, factor: int) -> Trial:
    """A burst of the built-in object at any size, with a little noise."""
    shape = (columns * factor * 2, rows * factor * 2)
    depth = cv2.resize(object_(), shape, interpolation=cv2.INTER_NEAREST)
    return make_trial(DepthMap(depth), variance=4.1, seed=0, frames=frames, upsampling=factor)


@cache
def object_() -> np.ndarray:
    """The built-in object."""
    return procedural_object()


def measure(method: Method, rows: int, columns: int, frames: int, factor: int, bandwidth: float) -> Row:
    """Fuse three times after a warm-up; registration and solve are those of the fastest."""
    trial = burst(rows, columns, frames, factor)
    options = FusionOptions(method=method, upsampling=factor)
    amplitude = np.ones_like(trial.distance) if method == "phasor" else None
    span = AMBIGUITY_RANGE if method == "phasor" else None

    def once() -> Fused:
        return fuse(trial.distance, amplitude, options=options, ambiguity_range=span)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FusionWarning)
        once()
        held = reset_peak()
        runs = [once().report]
        peak = peak_memory() - held
        runs += [once().report for _ in range(2)]
    best = min(runs, key=lambda report: report.seconds.solve)
    ratio = None
    if method in TRAFFIC and best.iterations:
        pixels = rows * columns * factor**2
        ratio = best.seconds.solve * bandwidth / (best.iterations * pixels * TRAFFIC[method])
    return Row(
        method,
        rows,
        columns,
        frames,
        factor,
        min(report.seconds.registration for report in runs),
        best.seconds.solve,
        best.iterations,
        best.gap,
        best.converged,
        peak,
        ratio,
    )


def reset_peak() -> int:
    """Give freed memory back, forget the highest use so far (Linux) and return the present one, bytes."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def peak_memory() -> int:
    """Highest memory use since `reset_peak`, bytes."""
    return _status("VmHWM")


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith(name + ":")).split()[1])


@numba.njit(parallel=True, fastmath=True)
def _triad(a, b, c):
    for i in numba.prange(a.size):
        a[i] = b[i] + np.float32(3.0) * c[i]


def memory_bandwidth() -> float:
    """Bytes per second of a = b + 3 c on arrays of 256 MB, the best of five; three streams are counted."""
    a, b, c = (np.ones(64 << 20, np.float32) for _ in range(3))
    _triad(a, b, c)
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        _triad(a, b, c)
        times.append(time.perf_counter() - begin)
    return 3 * a.nbytes / min(times)


def show(rows: list[Row]) -> None:
    """The table as text."""
    print(
        "method         frames        N   β  registration     solve  iterations"
        "      gap  peak memory  × bandwidth"
    )
    for row in rows:
        size = f"{row.columns} × {row.rows}"
        gap = "–" if row.gap is None else f"{row.gap:.1e}"
        ratio = "–" if row.bandwidth_ratio is None else f"{row.bandwidth_ratio:.1f}"
        limit = " " if row.converged else "*"
        print(
            f"{row.method:<14} {size:<10} {row.frames:>4} {row.upsampling:>3} {row.registration:>11.3f} s "
            f"{row.solve:>7.3f} s {row.iterations:>10}{limit} {gap:>8} {row.peak / 2**20:>9.0f} MB "
            f"{ratio:>12}"
        )
    if not all(row.converged for row in rows):
        print("* stopped by max_iterations")


def show_growth(rows: list[Row]) -> None:
    """Exponents of solve time with fused pixels (N and β fixed) and of all time with N."""
    print("\nmethod         time ∝ pixels^p   time ∝ N^q")
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method]
        p = exponent(
            [(row.rows * row.columns * row.upsampling**2, row.solve) for row in own if row.frames == 15]
        )
        q = exponent(
            [
                (row.frames, row.solve + row.registration)
                for row in own
                if (row.rows, row.upsampling) == (144, 4)
            ]
        )
        print(f"{method:<14} {p:>15} {q:>12}")


def exponent(points: list[tuple[float, float]]) -> str:
    """Slope of log time over log size."""
    if len({size for size, _ in points}) < 2:
        return "–"
    size, seconds = np.log(np.array(points)).T
    return f"{np.polyfit(size, seconds, 1)[0]:.2f}"


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="full frames and the smallest, β = 4, N = 15 alone"
    )
    parser.add_argument("--json", type=Path, help="save everything here as well")
    parser.add_argument("--patches", type=int, default=4, help="patches given to each of CVXPY's solvers")
    chosen = parser.parse_args()
    grid = product(SIZES, FRAMES, FACTORS)
    if chosen.quick:
        grid = product((SIZES[0], SIZES[-1]), (15,), (4,))
    bandwidth = memory_bandwidth()
    print(f"memory bandwidth {bandwidth / 1e9:.1f} GB/s, {numba.get_num_threads()} threads\n")
    rows = []
    for (height, width), frames, factor in grid:
        rows += [measure(method, height, width, frames, factor, bandwidth) for method in METHODS]
    show(rows)
    show_growth(rows)
    trial = burst(50, 50, 10, 4)
    references = compare_patches(trial, chosen.patches) if chosen.patches else []
    for reference in references:
        print("\n" + reference.text)
    if chosen.json:
        store(
            chosen.json,
            bandwidth=bandwidth,
            rows=[asdict(row) for row in rows],
            patches=[asdict(reference) for reference in references],
        )


if __name__ == "__main__":
    main()
