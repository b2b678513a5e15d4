"""The pages' tables of the battery's rows."""

import sys
from pathlib import Path

from stored import Results

sys.path.append(str(Path(__file__).parent / "battery"))

from table import Row, mean, pick, rises, summary

METHODS = "nearest", "lidarboost", "area", "phasor"
CONDITIONS = {"base": "as it is", "noise/4": "noise ÷ 4", "N=60": "N = 60"}
OTHERS = {
    "base": "as it is",
    "shot": "shot noise",
    "span=1": "span 1 px",
    "span=30": "span 30 px",
    "lens": "a lens that moves the corners by 4 px",
    "guess": "the stage's angles as a guess",
    "estimated": "poses estimated",
    "untold": "noise estimated",
    "saturation": "lost from 2,500 counts",
    "wild": "one wild sample in 500",
    "noise/16": "a sixteenth of the noise",
    "noise*4": "four times the noise",
    "N=4": "four frames",
    "x2": "×2",
    "x8": "×8",
    "dim": "no amplitude (`area`)",
}


def scenes(stored: Results) -> list[str]:
    """A set of scenes, together and each."""
    rows: list[Row] = stored["rows"]
    names = list(dict.fromkeys(row["scene"] for row in rows))
    return [*_together(rows, names), "", *_each(rows, names)]


def conditions(stored: Results) -> list[str]:
    """The default method under other conditions."""
    rows: list[Row] = stored["rows"]
    names = list(dict.fromkeys(row["scene"] for row in rows))
    lines = _head("RMS / mean absolute error, mm", *(f"`{scene}`" for scene in names))
    for condition, text in OTHERS.items():
        method = "area" if condition == "dim" else "phasor"
        if not pick(rows, names[0], condition, method):
            continue
        lines.append(_line(text, *(_errors(pick(rows, scene, condition, method)) for scene in names)))
    return lines


def metrology(stored: Results) -> list[str]:
    """What is measured of made things."""
    found = stored["metrology"]
    lines = _head("", *(f"`{method}`" for method in found))
    for name in next(iter(found.values())):
        lines.append(_line(name, *(f"{values[name]:.2f}" for values in found.values())))
    return lines


def _together(rows: list[Row], names: list[str]) -> list[str]:
    lines = _head(
        "condition",
        "method",
        "ratio to the limit, RMS / mean",
        "away from edges, mm",
        "within one deviation, away",
        "within two at edges, median",
        "RMS rises at most",
    )
    for condition, text in CONDITIONS.items():
        for method in METHODS:
            found = summary(rows, condition, method, names)
            if found is None:
                continue
            scene, rise = next(iter(rises(rows, condition, method).items()))
            lines.append(
                _line(
                    text,
                    f"`{method}`",
                    f"{found.rms:.2f} / {found.mean:.2f}",
                    f"{found.away:.2f}",
                    f"{100 * found.least:.0f}–{100 * found.most:.0f} %",
                    f"{100 * found.near:.0f} %",
                    "" if condition == "base" else f"{100 * (rise - 1):+.1f} % (`{scene}`)",
                )
            )
    return lines


def _each(rows: list[Row], names: list[str]) -> list[str]:
    lines = _head("RMS / mean absolute error, mm, as it is", "limit", *(f"`{method}`" for method in METHODS))
    for scene in names:
        cells = [_errors(pick(rows, scene, "base", method)) for method in ("limit", *METHODS)]
        lines.append(_line(f"`{scene}`", *cells))
    return lines


def _errors(rows: list[Row]) -> str:
    if not rows:
        return "–"
    rms, average = mean(rows, "rms_all"), mean(rows, "mean_all")
    return f"{rms:.{0 if rms >= 20 else 1}f} / {average:.1f}"


def _head(*cells: str) -> list[str]:
    return [_line(*cells), "|---" * len(cells) + "|"]


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"
