"""How near `auto` comes to the best λ: `python tests/benchmarks/regularization.py [--scene NAME]`.

One table: for each method with a λ, each scene and noise level, the errors at `auto`, the least of a sweep
from an eighth to eight times that λ (each measure's own), and their ratio; errors are means over the seeds.
The built-in object and, where the file is at hand, the scanned figure come by the paper's protocol, in units
of its depth (0..182), the recordings in `recordings/` as they are; their displacements are estimated, once
per burst. Four tuning scenes of the battery come with N 4 to 60, β 2 to 8, and a sixteenth to four times the
noise. Of these and the recordings errors are in mm, λ in m (`phasor`: a factor).
"""

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.poses import relative_rotations
from drivers.recording import open_recording
from service.config.sections import FusionSection
from service.fusion.fuse import stack
from service.jobs.fuse import recorded_bursts
from solver import Footprint, FusionOptions, FusionWarning, fuse
from solver.evaluation import MATCHED, DepthMap, errors, make_trial, procedural_object
from solver.options import Method
from solver.preparation.noise import estimate

sys.path.append(str(Path(__file__).parent / "battery"))

from catalogue import to_tune
from rig import CONDITIONS, capture, look

Image = NDArray[np.float32]
ROOT = Path(__file__).parents[2]
FIGURE = ROOT.parent / "shared" / "data" / "bunny_depth.npz"
RECORDINGS = ("wedges", "objects")
SCENES = ("boxes", "stairs", "blobs", "dark")
SEEN = ("base", "noise/16", "noise/4", "noise*4", "N=4", "N=60", "x2", "x8")
METHODS: tuple[Method, ...] = ("ibsr", "mrf", "lidarboost", "area", "phasor")
FACTORS = (1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0)
ENOUGH = 1.10  # of the best error: nobody would turn λ for less
NOTES = """\
ibsr: the paper's λ is 0.04.
mrf: guided by the fused amplitude; object and figure have none, and all links are equal.
phasor: needs amplitude, which the built-in object and the figure lack: left out there."""


@dataclass(frozen=True)
class Case:
    """One burst, `name` says of what noise or condition; `given` are the arguments of `fuse`."""

    scene: str
    name: str
    seed: int
    truth: Image
    scale: float
    given: Mapping[str, Any]
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Row:
    """One method on one case of a scene.

    Attributes:
        strength: λ of `auto`, mean over the seeds.
        rms, mae: by factor on that λ.
    """

    method: str
    scene: str
    case: str
    seeds: int
    strength: float
    rms: dict[float, float]
    mae: dict[float, float]

    @property
    def ratios(self) -> tuple[float, float]:
        """Errors at `auto` over the least, RMS and mean absolute."""
        return self.rms[1.0] / min(self.rms.values()), self.mae[1.0] / min(self.mae.values())


def registered(scene: str, level: str, seed: int, truth: Image, scale: float, /, **given: Any) -> Case:
    """The burst with the displacements that `fuse` finds, without the frames it rejects."""
    options = given.pop("options", {})
    found = fuse(options=FusionOptions(method="nearest"), **given)
    used = list(found.report.used)
    given.pop("initial", None)
    for name in ("distance", "amplitude"):
        given[name] = None if given[name] is None else given[name][used]
    if found.rotations is None:
        given["shifts"] = found.shifts[used]
    else:
        given["rotations"] = found.rotations[used]
    return Case(scene, level, seed, truth, scale, given, options)


def protocol(scene: str, depth: DepthMap, seeds: int) -> Iterator[Case]:
    """Bursts of a depth map at the paper's noise levels."""
    for variance in MATCHED:
        for seed in range(seeds):
            trial = make_trial(depth, variance=variance, seed=seed)
            yield registered(
                scene, f"{variance:g}", seed, trial.truth, 1.0, distance=trial.distance, amplitude=None
            )


def built_in(seeds: int) -> Iterator[Case]:
    """The built-in object."""
    yield from protocol("object", DepthMap(procedural_object(), oversampling=2), seeds)


def figure(seeds: int) -> Iterator[Case]:
    """The scanned figure."""
    with np.load(FIGURE) as data:
        depth = DepthMap(data["fine"], oversampling=4)
    yield from protocol("figure", depth, seeds)


def recorded(name: str, _seeds: int) -> Iterator[Case]:
    """The first burst of a bundled recording as the daemon fuses it."""
    recording = open_recording(ROOT / "recordings" / f"{name}.mcap")
    calibration, truth = recording.calibration, recording.truth
    if truth is None:
        raise SystemExit(f"{recording.path} carries no truth")
    burst = next(recorded_bursts(recording, FusionSection(), calibration))
    distance, amplitude = stack(burst.frames, calibration)
    law, footprint, span = calibration.noise, calibration.footprint, burst.reference.ambiguity_range
    noise = estimate(distance, amplitude, span)
    if law is not None:
        noise = law.for_signal(burst.reference.integration_time)
    yield registered(
        name,
        "as is",
        0,
        truth,
        1e3,
        distance=distance,
        amplitude=amplitude,
        initial=relative_rotations([(f.pan, f.tilt) for f in burst.frames], calibration.mount),
        intrinsics=calibration.intrinsics.matrix,
        distortion=calibration.distortion or None,
        ambiguity_range=span,
        noise=noise,
        options={"footprint": Footprint(side=footprint.fill_factor, blur=footprint.blur)},
    )


def seen(name: str, seeds: int) -> Iterator[Case]:
    """A tuning scene of the battery under conditions of N, β and noise, exact poses."""
    view = look(to_tune(name), tuple({CONDITIONS[label].upsampling for label in SEEN}))
    for label in SEEN:
        condition = CONDITIONS[label]
        for seed in range(seeds):
            given = capture(view, condition, seed).given
            options = {"upsampling": condition.upsampling}
            yield Case(name, label, seed, view.truth[condition.upsampling], 1e3, given, options)


Source = Callable[[int], Iterator[Case]]


def scenes() -> dict[str, Source]:
    """What there is to fuse, by name."""
    found: dict[str, Source] = {"object": built_in}
    if FIGURE.exists():
        found["figure"] = figure
    found |= {name: partial(recorded, name) for name in RECORDINGS}
    return found | {name: partial(seen, name) for name in SCENES}


def sweep(case: Case, method: Method) -> Row:
    """The errors of one method on one burst at every λ."""

    def errs(strength: Any) -> tuple[float, float, float]:
        options = FusionOptions(method=method, regularization=strength, **case.options)
        found = fuse(options=options, **case.given)
        error = errors(found.distance, case.truth)
        return found.report.regularization or 0.0, case.scale * error.rmse, case.scale * error.mae

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FusionWarning)  # a λ far too small converges slowly
        automatic, rms, mae = errs("auto")
        others = {f: errs(f * automatic) for f in FACTORS if f != 1}
    tried = {f: others[f][1:] if f != 1 else (rms, mae) for f in FACTORS}
    first, second = ({f: pair[i] for f, pair in tried.items()} for i in (0, 1))
    return Row(method, case.scene, case.name, 1, automatic, first, second)


def mean(rows: list[Row]) -> Row:
    """One row over the seeds: mean squared and mean absolute errors averaged."""
    one = rows[0]
    rms = {f: float(np.sqrt(np.mean([row.rms[f] ** 2 for row in rows]))) for f in FACTORS}
    mae = {f: float(np.mean([row.mae[f] for row in rows])) for f in FACTORS}
    strength = float(np.mean([row.strength for row in rows]))
    return Row(one.method, one.scene, one.case, len(rows), strength, rms, mae)


def measure(sources: Mapping[str, Source], methods: list[Method], seeds: int) -> list[Row]:
    """Rows by method, scene and case; a line on stderr for each burst and method."""
    found: dict[tuple[str, str, str], list[Row]] = {}
    for source in sources.values():
        for case in source(seeds):
            for method in methods:
                if method == "phasor" and case.given["amplitude"] is None:
                    continue
                print(f"{method}, {case.scene}, {case.name}, seed {case.seed}", file=sys.stderr)
                found.setdefault((method, case.scene, case.name), []).append(sweep(case, method))
    order: dict[str, int] = {method: number for number, method in enumerate(METHODS)}
    return sorted((mean(rows) for rows in found.values()), key=lambda row: order[row.method])


def show(rows: list[Row]) -> None:
    """The table as text."""
    print(
        "method      scene        case        λ   RMS auto    best  at λ ×  ratio "
        "  mean abs. auto    best  at λ ×  ratio"
    )
    for row in rows:
        left, right = (
            f"{by[1.0]:>{width}.3f} {min(by.values()):>7.3f} {min(by, key=by.__getitem__):>7g} {ratio:>6.2f}"
            f"{' ' if ratio <= ENOUGH else '!'}"
            for by, ratio, width in zip((row.rms, row.mae), row.ratios, (10, 16), strict=True)
        )
        print(f"{row.method:<11} {row.scene:<8} {row.case:>8} {row.strength:>8.3g} {left} {right}")
    print(f"! more than {ENOUGH:g} of the best\n{NOTES}")


def main() -> None:
    """Run everything and print it."""
    available = scenes()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="bursts of each depth map and noise level")
    parser.add_argument("--scene", action="append", choices=list(available), help="only this; repeatable")
    parser.add_argument("--method", action="append", choices=METHODS, help="only this; repeatable")
    parser.add_argument("--json", type=Path, help="save everything here as well")
    chosen = parser.parse_args()
    if chosen.seeds < 1:
        parser.error(f"--seeds is {chosen.seeds}; expected at least 1")
    picked = {name: available[name] for name in chosen.scene or available}
    rows = measure(picked, chosen.method or list(METHODS), chosen.seeds)
    show(rows)
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(row) for row in rows], indent=2))


if __name__ == "__main__":
    main()
