"""`lidarboost evaluate`: the LidarBoost paper's experiments on any known depth map."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from solver.options import Method

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from service.evaluation.truth import Truth
    from solver.evaluation import Lambda, Outcome, Region, Setting

DEFAULT_METHODS: tuple[Method, ...] = (
    "nearest",
    "bicubic",
    "shift-and-add",
    "ibsr",
    "mrf",
    "lidarboost",
    "area",
)
"""All that need no amplitude: a depth map has none."""


class Noise(StrEnum):
    """Which of the paper's noise levels."""

    literal = "literal"
    matched = "matched"
    both = "both"


class Format(StrEnum):
    """How the table is written to standard output."""

    text = "text"
    json = "json"
    csv = "csv"


def evaluate(
    truth: Annotated[
        Path | None,
        typer.Option(
            help="True depth map: npy, npz, png or a simulated mcap.", show_default="built-in object"
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option("--method", help="Repeat for several.", show_default="all but phasor"),
    ] = None,
    noise: Annotated[
        Noise, typer.Option(help="0, 0.7, 5 as the paper says, or 0, 4.1, 46.3 as it shows.")
    ] = Noise.matched,
    variance: Annotated[
        list[float] | None, typer.Option(min=0, help="Noise variance, depth on 0..182; replaces --noise.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Bursts per noise level.")] = 5,
    frames: Annotated[int, typer.Option(min=1, max=200, help="N.")] = 10,
    upsampling: Annotated[int, typer.Option(min=1, max=16, help="β.")] = 4,
    regularization: Annotated[
        list[float] | None, typer.Option(min=0, help="λ; several draw a curve.", show_default="auto")
    ] = None,
    region: Annotated[
        str | None, typer.Option(help="Region of interest: TOP,LEFT,HEIGHT,WIDTH in low-resolution pixels.")
    ] = None,
    exact_shifts: Annotated[
        bool, typer.Option(help="Use the true displacements instead of estimating them.")
    ] = False,
    ablations: Annotated[
        bool, typer.Option(help="The paper's ablations instead of a comparison of methods.")
    ] = False,
    output: Annotated[Path | None, typer.Option(help="Directory for tables and pictures.")] = None,
    table: Annotated[Format, typer.Option("--format", help="Of the table on standard output.")] = Format.text,
) -> None:
    """Compare fusion methods on a known depth map, as the LidarBoost paper does.

    Frames are means over shifted pixels with Gaussian noise; the depth map
    is brought to 0..182, the paper's range. With --output, tables, the error
    against λ, colour-coded errors, shaded surfaces and the amplitude's
    cut-off are saved there.

    [bold]Examples[/bold]

      lidarboost evaluate --seeds 3

      lidarboost evaluate --truth object.npz --method lidarboost --method area --output out

      lidarboost evaluate --method area --regularization 1 --regularization 3 --output out

      lidarboost evaluate --ablations --noise both
    """
    from service.evaluation import table as tables
    from service.evaluation.truth import load_truth
    from solver.evaluation import LITERAL, MATCHED, Setting, compare
    from solver.evaluation.variants import compare_ablations

    source = load_truth(truth)
    setting = Setting(source.depth, frames, upsampling, _region(region), exact_shifts)
    levels = {Noise.literal: LITERAL, Noise.matched: MATCHED, Noise.both: tuple(sorted({*LITERAL, *MATCHED}))}
    variances = tuple(variance) if variance else levels[noise]
    methods = _methods(method)
    with _told() as tell:
        if ablations:
            outcomes = compare_ablations(setting, variances, range(seeds), tell)
        else:
            strengths: tuple[Lambda, ...] = tuple(regularization) if regularization else ("auto",)
            outcomes = compare(setting, methods, variances, range(seeds), lambdas=strengths, told=tell)
    texts = {
        Format.text: tables.as_text(outcomes) + "\n",
        Format.json: tables.as_json(outcomes) + "\n",
        Format.csv: tables.as_csv(outcomes),
    }
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for kind, suffix in ((Format.text, "txt"), (Format.json, "json"), (Format.csv, "csv")):
            (output / f"table.{suffix}").write_text(texts[kind], encoding="utf-8")
        _draw(
            output,
            source,
            setting,
            methods,
            variances,
            outcomes,
            swept=bool(regularization),
            ablated=ablations,
        )
    print(texts[table], end="")


def _methods(names: list[str] | None) -> tuple[Method, ...]:
    known = [name for name in get_args(Method) if name not in ("auto", "phasor")]
    for name in names or ():
        if name not in known:
            why = "needs amplitude, which a depth map lacks" if name == "phasor" else "is no method"
            raise typer.BadParameter(f"--method {name} {why}; expected {', '.join(known)}")
    return tuple(cast(Method, name) for name in names) if names else DEFAULT_METHODS


def _region(text: str | None) -> "Region | None":
    from solver.evaluation import Region

    if text is None:
        return None
    try:
        top, left, height, width = (int(part) for part in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r}; expected four whole numbers TOP,LEFT,HEIGHT,WIDTH") from error
    return Region(top, left, height, width)


@contextmanager
def _told() -> Iterator[Callable[[str], None]]:
    """A spinner with what is running on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from service.cli.terminal import spinner

    with spinner("evaluating") as tell:
        yield tell


def _draw(
    output: Path,
    source: "Truth",
    setting: "Setting",
    methods: tuple[Method, ...],
    variances: tuple[float, ...],
    outcomes: "list[Outcome]",
    *,
    swept: bool,
    ablated: bool,
) -> None:
    """Pictures of the first seed at every noise level, each method at its best λ of those that ran."""
    from service.evaluation import pictures
    from solver.evaluation import run_method
    from solver.evaluation.variants import dark_print
    from solver.preparation import noise as noise_law

    if swept:
        pictures.write_sweep(output / "error_against_lambda.png", outcomes)
    for variance in variances:
        trial = setting.trial(variance, 0)
        maps: dict[str, NDArray[np.float32]] = {}
        for name in methods:
            rows = [row for row in outcomes if (row.method, row.variance) == (name, variance)]
            best = min(rows, key=lambda row: row.mse).regularization if rows and swept else None
            strength: Lambda = "auto" if best is None else best
            maps[name] = run_method(trial, name, setting, regularization=strength).distance
        pictures.write_errors(output / f"errors_{variance:g}.png", maps, trial.truth)
        pictures.write_surfaces(output / f"surfaces_{variance:g}.png", {"truth": trial.truth, **maps})
    amplitude = source.amplitude
    if amplitude is None and ablated:
        amplitude = dark_print(setting, max(variances), 0).amplitude[0]
    if amplitude is not None:
        threshold = noise_law.amplitude_threshold(amplitude[None], 0.0, None)
        pictures.write_cutoff(output / "amplitude_cutoff.png", amplitude, threshold)
