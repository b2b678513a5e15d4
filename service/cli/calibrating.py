"""What the `calibrate` commands share: where frames come from, the board, the file and its picture."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivers.calibration import Calibration
    from service.calibration.board import Board
    from service.calibration.footage import Footage
    from service.calibration.pictures import Fit
    from service.config.sections import Configuration


def footage_of(recordings: list[Path] | None, config: Path | None, frames: int) -> list[Footage]:
    """Frames of the recordings, or of the configured camera."""
    from service.calibration.footage import film, recorded

    return recorded(recordings) if recordings else [film(configured(config), frames)]


def configured(config: Path | None) -> Configuration:
    """The configuration of a live camera; raises `ConfigurationError` where none is given."""
    from service.config.file import load
    from service.errors import ConfigurationError

    if config is None:
        raise ConfigurationError("nothing to calibrate with: give recordings, or a camera by --config FILE")
    return load(config)


def base_of(base: Path | None, known: Calibration) -> Calibration:
    """The calibration to start from."""
    from drivers.calibration import Calibration

    return Calibration.load(base) if base is not None else known


def board_of(corners: str, square: float, charuco: str | None, marker: float) -> Board:
    """The board as described on the command line; raises `ConfigurationError` where that makes no sense."""
    from service.calibration.board import Board
    from service.errors import ConfigurationError

    columns, _, rows = corners.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and int(columns) >= 3 and int(rows) >= 3):
        raise ConfigurationError(f"--board: expected inner corners as in 9x6, at least 3x3, got {corners!r}")
    if charuco is not None and not 0 < marker < square:
        raise ConfigurationError(f"--marker: expected a side between 0 and the field's {square:g} mm")
    return Board(int(columns), int(rows), square / 1e3, charuco, marker / 1e3)


def check_output(output: Path, base: Path | None, force: bool) -> None:
    """Raise `OutputError` rather than replace a file that is not the base."""
    from service.errors import OutputError

    is_base = base is not None and output.exists() and output.samefile(base)
    if output.exists() and not (force or is_base):
        raise OutputError(f"{output} exists already; choose another name (-o), or replace it with --force")


def save(fit: Fit, part: str, known: Calibration, output: Path, as_json: bool) -> None:
    """Write the calibration and its picture, and say so."""
    import json

    from service.calibration.pictures import save_picture

    kept = [said for said in known.source.split("; ") if not said.startswith(f"{part} calibrated")]
    found = fit.apply(known).model_copy(update={"source": "; ".join([*kept, f"{part} calibrated"])})
    picture = output.with_suffix(f".{part}.png")
    found.save(output)
    save_picture(picture, fit, found.shape)
    warnings = getattr(fit, "warnings", ())
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if as_json:
        said = {"summary": str(fit), "calibration": found.model_dump(mode="json"), "picture": str(picture)}
        print(json.dumps(said, indent=2))
    else:
        print(f"{part}: {fit}\nwrote {output} and {picture}")


@contextmanager
def counted() -> Iterator[Callable[[int, int], None]]:
    """Shows views and frames so far: one line that changes on a terminal, a line per view elsewhere."""
    last = -1

    def tell(views: int, frames: int) -> None:
        nonlocal last
        if sys.stderr.isatty():
            print(f"\r{views} views in {frames} frames ", end="", file=sys.stderr, flush=True)
        elif views != last:
            print(f"{views} views in {frames} frames", file=sys.stderr)
        last = views

    yield tell
    if sys.stderr.isatty():
        print(file=sys.stderr)
