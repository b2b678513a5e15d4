"""Every method on scenes of many kinds: `python tests/benchmarks/battery [--quick] [--json FILE]`.

A table by scene for each condition (RMS / mean absolute error, mm; everywhere, away from edges, at edges, at
borders) with the ratios to the limit, which is what a noise-free camera of the fused resolution errs by;
consistency, what happens with better data; where one frame errs less; and metrology. An unknown cell counts
0.5 m. Scenes with * may be tuned with; ratios are geometric means over scenes whose limit exceeds 1 mm RMS.
`--quick`: five scenes, one seed, no metrology.

The pages' tables are made (`figures.py`) of what is stored in `tests/benchmarks/results` under these names:

    --seeds 1 --set reported --metrology no --json …/reported.json
    --seeds 1 --set tuning --metrology no --json …/tuning.json
    --seeds 1 --metrology only --json …/metrology.json
    --seeds 1 --condition all --scene stairs --scene dark --scene boxes --scene treads --scene objects
        --scene desk --method area --method phasor --metrology no --json …/conditions.json
"""

import argparse
import sys
import time
import warnings
from pathlib import Path

from catalogue import SCENES, to_report
from measures import measure, regions
from metrology import EXPERIMENTS, Reading
from reported import REPORTED
from rig import BASE, CONDITIONS, RANGE, Burst, capture, limit, look
from table import Row, show
from tuning import TUNING

from solver import Fused, FusionError, FusionOptions, FusionWarning, fuse
from solver.geometry.positions import sample_positions
from solver.options import Method

sys.path.append(str(Path(__file__).parents[1]))

from stored import store

METHODS: tuple[Method, ...] = ("nearest", "lidarboost", "area", "phasor")
BETTER = ("noise/4", "N=60")
QUICK = ("boxes", "stairs", "wires", "bright", "sky")


def fused(burst: Burst, method: Method, factor: int) -> Fused | None:
    """The map, or None where the method cannot be used."""
    given = burst.given
    if method == "phasor" and "amplitude" not in given:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FusionWarning)
        return fuse(options=FusionOptions(method=method, upsampling=factor), **given)


def run(scenes: list[str], conditions: list[str], methods: list[Method], seeds: int) -> list[Row]:
    """One row by scene, condition, method and seed."""
    rows: list[Row] = []
    factors = tuple(sorted({CONDITIONS[name].upsampling for name in conditions}))
    for number, name in enumerate(scenes):
        begin = time.perf_counter()
        lenses = {CONDITIONS[label].lens for label in conditions}
        views = {lens: look(to_report(name), factors, lens=lens) for lens in lenses}
        limits = {(lens, f): limit(view, f) for lens, view in views.items() for f in factors}
        for label in conditions:
            condition = CONDITIONS[label]
            factor, view = condition.upsampling, views[condition.lens]
            truth = view.truth[factor]
            for seed in range(seeds):
                burst = capture(view, condition, seed)
                shape = burst.distance.shape
                positions = sample_positions(
                    shape,
                    rotations=burst.rotations,
                    intrinsics=burst.given["intrinsics"],
                    distortion=burst.given.get("distortion"),
                )
                region = regions(truth, positions, factor)
                best = measure(limits[condition.lens, factor], None, truth, region, RANGE)
                head = {"scene": name, "condition": label, "seed": seed}
                rows.append({**head, "method": "limit", **best})
                for method in methods:
                    try:
                        found = fused(burst, method, factor)
                    except FusionError as error:
                        print(f"{name}, {label}, {method}: {error}", file=sys.stderr)
                        continue
                    if found is None:
                        continue
                    values = measure(found.distance, found.deviation, truth, region, RANGE)
                    values |= {
                        "seconds": found.report.seconds.solve,
                        "rejected": float(len(found.report.rejected)),
                        "noise": (found.report.noise or 0.0) / burst.noise,
                    }
                    rows.append({**head, "method": method, **values})
        print(f"{number + 1}/{len(scenes)} {name} {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    return rows


def experiments(methods: list[Method], seeds: int) -> dict[str, dict[str, float]]:
    """Metrology by method."""
    found: dict[str, dict[str, float]] = {}
    for method in methods:

        def once(burst: Burst, method: Method = method) -> Reading:
            result = fused(burst, method, BASE.upsampling)
            assert result is not None
            return result.distance, result.deviation

        found[method] = {}
        for name, experiment in EXPERIMENTS.items():
            begin = time.perf_counter()
            found[method] |= experiment(once, seeds)
            print(f"{name}, {method} {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    return found


def main() -> None:
    """Run what is asked for, print it and store it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="five scenes, one seed, no metrology")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--scene", action="append", choices=list(SCENES))
    parser.add_argument("--set", choices=("all", "tuning", "reported"), default="all")
    parser.add_argument(
        "--condition", action="append", choices=[*CONDITIONS, "all"], help="beside base; default: better data"
    )
    parser.add_argument("--method", action="append", choices=METHODS)
    parser.add_argument("--metrology", choices=("also", "only", "no"), default="also")
    parser.add_argument("--json", type=Path, help="store every row here")
    chosen = parser.parse_args()
    sets = {"all": SCENES, "tuning": TUNING, "reported": REPORTED}
    scenes = chosen.scene or list(QUICK if chosen.quick else sets[chosen.set])
    conditions = list(dict.fromkeys(["base", *(chosen.condition or BETTER)]))
    if "all" in conditions:
        conditions = list(CONDITIONS)
    methods = chosen.method or list(METHODS)
    seeds = 1 if chosen.quick else chosen.seeds
    rows = [] if chosen.metrology == "only" else run(scenes, conditions, methods, seeds)
    wanted = chosen.metrology != "no" and not chosen.quick
    found = experiments(methods, seeds) if wanted else {}
    show(rows, found, methods, set(TUNING))
    if chosen.json:
        store(chosen.json, rows=rows, metrology=found)


if __name__ == "__main__":
    main()
