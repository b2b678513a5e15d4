"""Make the pages' tables from stored results: `python tests/benchmarks/figures.py [--check]`.

A table stands in a page between `<!-- figures: NAME -->` and `<!-- end -->`; it is made of
`results/NAME.json`, which the benchmark of the same name writes with `--json`, or the battery (see there).
With `--check` nothing is written; the exit status says whether every page holds what is stored.
"""

import argparse
import re
import sys
from collections.abc import Callable
from pathlib import Path

from battery_tables import conditions, metrology, scenes
from stored import ROOT, Results, load

PAGES = "README.md", "solver/FIGURES.md"
NAMES = {"nearest": "one frame", "lidarboost": "`lidarboost`, the paper", "phasor": "`phasor`, the default"}
_BLOCK = re.compile(r"(<!-- figures: ([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def of(stored: Results) -> str:
    """Where figures are from, as a line."""
    machine = stored["machine"]
    return (
        f"*Commit {stored['commit']}, {stored['date']}, {machine['cores']} cores of {machine['processor']}, "
        f"Numba {machine['numba']}.*"
    )


def recordings(stored: Results) -> list[str]:
    """Errors by method and recording."""
    scenes = list(dict.fromkeys(row["scene"] for row in stored["rows"]))
    lines = [f"| RMS / mean absolute error, mm | {' | '.join(scenes)} |", "|---" * (len(scenes) + 1) + "|"]
    for method in dict.fromkeys(row["method"] for row in stored["rows"]):
        own = {row["scene"]: row for row in stored["rows"] if row["method"] == method}
        cells = [f"{own[scene]['rms']:.0f} / {own[scene]['mean']:.1f}" for scene in scenes]
        lines.append(f"| {NAMES.get(method, f'`{method}`')} | {' | '.join(cells)} |")
    return lines


def streaming(stored: Results) -> list[str]:
    """Rates and errors (RMS / mean absolute) of streams."""
    head = (
        "method",
        "scene",
        "maps/s",
        "usual, longest map",
        "error of the stream, mm",
        "of `fuse` on its end, mm",
    )
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in stored["rows"]:
        times = f"{row['rate']:.1f} | {row['usual']:.0f}, {row['longest']:.0f} ms"
        wrong = f"{_error(row['stream'])} | {_error(row['fuse'])}"
        lines.append(f"| `{row['method']}` | {row['scene']} | {times} | {wrong} |")
    return lines


def fusion(stored: Results) -> list[str]:
    """Times of one burst."""
    rows = [row for row in stored["rows"] if row["frames"] == 15 and row["upsampling"] == 4]
    sizes = list(dict.fromkeys((row["rows"], row["columns"]) for row in rows))
    sizes = [sizes[0], sizes[-1]]
    head = [f"{columns} × {lines}: solve, iterations" for lines, columns in sizes]
    lines = [f"| method | {' | '.join(head)} | peak memory | × bandwidth |", "|---" * (len(sizes) + 3) + "|"]
    for method in dict.fromkeys(row["method"] for row in rows):
        own = {(row["rows"], row["columns"]): row for row in rows if row["method"] == method}
        cells = [f"{own[size]['solve']:.3f} s, {own[size]['iterations']}" for size in sizes]
        large = own[sizes[-1]]
        ratio = "–" if large["bandwidth_ratio"] is None else f"{large['bandwidth_ratio']:.1f}"
        lines.append(f"| `{method}` | {' | '.join(cells)} | {large['peak'] / 2**20:.0f} MB | {ratio} |")
    return lines


def peers(stored: Results) -> list[str]:
    """What others make of the same frames."""
    head = "scene", "method", "RMS / mean absolute error, mm", "unknown", "seconds", "memory"
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in stored["rows"]:
        settings = ", ".join(f"{name} {value}" for name, value in row["settings"].items())
        method = f"{row['method']} ({settings})" if settings else f"`{row['method']}`"
        cost = f"{row['seconds']:.2f} | {row['peak'] / 2**20:.0f} MB"
        wrong = f"{row['rms']:.0f} / {row['mean']:.1f} | {row['unknown']:.1%}"
        lines.append(f"| {row['scene']} | {method} | {wrong} | {cost} |")
    return lines


TABLES: dict[str, Callable[[Results], list[str]]] = {
    "recordings": recordings,
    "streaming": streaming,
    "fusion": fusion,
    "peers": peers,
    "reported": scenes,
    "tuning": scenes,
    "conditions": conditions,
    "metrology": metrology,
}


def filled(text: str) -> str:
    """The page with every table made anew."""

    def block(found: re.Match[str]) -> str:
        stored = load(found[2])
        return f"{found[1]}{chr(10).join(TABLES[found[2]](stored))}\n\n{of(stored)}\n{found[3]}"

    return _BLOCK.sub(block, text)


def _error(pair: list[float]) -> str:
    return f"{pair[0]:.1f} / {pair[1]:.1f}"


def main() -> int:
    """Write the pages, or check them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; say which pages differ")
    check = parser.parse_args().check
    stale = 0
    for name in PAGES:
        page = ROOT / Path(name)
        before = page.read_text()
        after = filled(before)
        if after != before:
            stale += 1
            print(f"{name} {'differs from what is stored' if check else 'written'}")
            if not check:
                page.write_text(after)
    return int(check and stale > 0)


if __name__ == "__main__":
    sys.exit(main())
