"""Outcomes as text, JSON and CSV."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, fields

import numpy as np

from solver.evaluation import Outcome


def as_json(outcomes: Sequence[Outcome]) -> str:
    """Every outcome, one object each."""
    return json.dumps([asdict(outcome) for outcome in outcomes], indent=2)


def as_csv(outcomes: Sequence[Outcome]) -> str:
    """Every outcome, one row each."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Outcome)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(outcome) for outcome in outcomes)
    return text.getvalue()


def as_text(outcomes: Sequence[Outcome]) -> str:
    """Means over seeds, one row per noise level, method and λ, in the order in which they ran."""
    header = (
        "variance",
        "method",
        "λ",
        "MSE",
        "±",
        "of one frame",
        "MAE",
        "shift error",
        "iterations",
        "gap",
        "time",
    )
    rows = [header]
    for variance, method, strength, group in _groups(outcomes):
        mse = [outcome.mse for outcome in group]
        gaps = [outcome.gap for outcome in group if outcome.gap is not None]
        stopped = sum(not outcome.converged for outcome in group)
        rows.append(
            (
                f"{variance:g}",
                method,
                "–" if strength is None else f"{strength:.3g}",
                f"{np.mean(mse):.1f}",
                f"{np.std(mse):.1f}",
                f"{np.mean([outcome.relative for outcome in group]):.3f}",
                f"{np.mean([outcome.mae for outcome in group]):.2f}",
                f"{np.sqrt(np.mean([outcome.registration**2 for outcome in group])):.3f} px",
                f"{np.mean([outcome.iterations for outcome in group]):.0f}" + (" (limit)" if stopped else ""),
                f"{np.mean(gaps):.1e}" if gaps else "–",
                f"{np.mean([outcome.seconds for outcome in group]):.2f} s",
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def _groups(outcomes: Sequence[Outcome]) -> list[tuple[float, str, float | None, list[Outcome]]]:
    """Outcomes of all seeds together; the λ of `auto` differs between seeds, and its mean is shown."""
    found: dict[tuple[float, str, int], list[Outcome]] = {}
    seen: dict[tuple[float, str, int], int] = {}
    for outcome in outcomes:
        key = (outcome.variance, outcome.method, outcome.seed)
        position = seen[key] = seen.get(key, -1) + 1
        found.setdefault((outcome.variance, outcome.method, position), []).append(outcome)
    result = []
    for (variance, method, _), group in found.items():
        values = [outcome.regularization for outcome in group if outcome.regularization is not None]
        result.append((variance, method, float(np.mean(values)) if values else None, group))
    return result
