"""The battery's rows as text."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from measures import geometric

Row = dict[str, Any]
FLOOR = 1.0
"""mm RMS of the limit over which a scene counts in ratios."""


def mean(rows: Iterable[Row], name: str) -> float:
    """Over seeds; of squares where it is an RMS. NaN where there are none."""
    values = [row[name] for row in rows if name in row]
    if not values:
        return float("nan")
    if name.startswith("rms"):
        return float(np.sqrt(np.mean(np.square(values))))
    return float(np.mean(values))


def pick(rows: list[Row], scene: str, condition: str, method: str) -> list[Row]:
    """Those of all seeds."""
    wanted = (scene, condition, method)
    return [row for row in rows if (row["scene"], row["condition"], row["method"]) == wanted]


def show(
    rows: list[Row], metrology: dict[str, dict[str, float]], methods: list[str], tuned: set[str]
) -> None:
    """All tables."""
    if rows:
        for condition in dict.fromkeys(row["condition"] for row in rows):
            _show_scenes(rows, condition, methods, tuned)
        _show_consistency(rows, methods)
        _show_lost(rows, methods)
    if metrology:
        print("\nmetrology" + " " * 21 + "".join(f"{name:>12}" for name in metrology))
        for name in next(iter(metrology.values())):
            print(
                f"{name:<30}" + "".join(f"{found.get(name, np.nan):>12.2f}" for found in metrology.values())
            )


def _show_scenes(rows: list[Row], condition: str, methods: list[str], tuned: set[str]) -> None:
    print(f"\n{condition}: RMS / mean absolute error, mm")
    print(
        "scene     method         everywhere            away           edges         borders  "
        "<1σ away <2σ edge unknown rejected noise seconds"
    )
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    for scene in scenes:
        for method in ("limit", *methods):
            own = pick(rows, scene, condition, method)
            if not own:
                continue
            parts = [
                f"{mean(own, f'rms_{name}'):>7.1f} /{mean(own, f'mean_{name}'):>6.1f}"
                for name in ("all", "away", "edges", "borders")
            ]
            rest = [mean(own, name) for name in ("within_away", "within_edges", "unknown")]
            shares = "".join(f"{100 * value:>8.1f}%" for value in rest)
            others = "".join(f"{mean(own, name):>8.2f}" for name in ("rejected", "noise", "seconds"))
            star = "*" if scene in tuned else " "
            print(f"{scene + star:<9} {method:<11}" + " ".join(parts) + shares + others)
    for kind, names in _kinds(scenes, tuned):
        for method in methods:
            print(f"{kind}, {method:<11}" + _line(summary(rows, condition, method, names)))


def _kinds(scenes: list[str], tuned: set[str]) -> list[tuple[str, list[str]]]:
    kinds = (
        ("reported", [s for s in scenes if s not in tuned]),
        ("tuning", [s for s in scenes if s in tuned]),
    )
    return [(kind, names) for kind, names in kinds if names]


@dataclass(frozen=True)
class Summary:
    """A method over many scenes.

    Attributes:
        rms, mean: geometric means of the ratios to the limit, over the `scenes` whose limit exceeds `FLOOR`.
        away, edges, borders: mean absolute errors there, mm, mean over all scenes.
        least, most: of the scenes' shares within one deviation, away from edges.
        near: median of their shares within two deviations, at edges.
    """

    rms: float
    mean: float
    scenes: int
    away: float
    edges: float
    borders: float
    least: float
    most: float
    near: float


def summary(rows: list[Row], condition: str, method: str, scenes: Iterable[str]) -> Summary | None:
    """Of the scenes that have rows; None where none has."""
    pairs = [(pick(rows, s, condition, method), pick(rows, s, condition, "limit")) for s in scenes]
    pairs = [(own, limit) for own, limit in pairs if own]
    if not pairs:
        return None
    wide = [(own, limit) for own, limit in pairs if mean(limit, "rms_all") > FLOOR]
    first, second = (
        geometric([mean(own, name) / mean(limit, name) for own, limit in wide])
        for name in ("rms_all", "mean_all")
    )
    away, edges, borders = (
        float(np.nanmean([mean(own, f"mean_{part}") for own, _ in pairs]))
        for part in ("away", "edges", "borders")
    )
    inside = [mean(own, "within_away") for own, _ in pairs]
    near = float(np.nanmedian([mean(own, "within_edges") for own, _ in pairs]))
    bounds = float(np.nanmin(inside)), float(np.nanmax(inside))
    return Summary(first, second, len(wide), away, edges, borders, *bounds, near)


def _line(found: Summary | None) -> str:
    if found is None:
        return " –"
    return (
        f" ratio to the limit {found.rms:.2f} {found.mean:.2f} over {found.scenes} scenes; "
        f"away {found.away:.1f} mm edges {found.edges:.1f} mm borders {found.borders:.1f} mm; "
        f"<1σ away {100 * found.least:.0f}–{100 * found.most:.0f} %, "
        f"<2σ edges median {100 * found.near:.0f} %"
    )


BETTER = ("noise/2", "noise/4", "noise/16", "N=30", "N=60")
"""Conditions of better data than `base`."""


def rises(rows: list[Row], condition: str, method: str) -> dict[str, float]:
    """RMS by scene in units of that under `base`, the greatest first."""
    found = {}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        before, after = (pick(rows, scene, c, method) for c in ("base", condition))
        if before and after:
            found[scene] = mean(after, "rms_all") / mean(before, "rms_all")
    return dict(sorted(found.items(), key=lambda x: -x[1]))


def _show_consistency(rows: list[Row], methods: list[str]) -> None:
    """Where better data make a map worse."""
    print("\nconsistency: scenes whose RMS rises by over 2 % against base (by how much at most)")
    for condition in dict.fromkeys(row["condition"] for row in rows):
        if condition not in BETTER:
            continue
        for method in methods:
            found = rises(rows, condition, method)
            worse = {scene: rise for scene, rise in found.items() if rise > 1.02}
            text = ", ".join(f"{scene} {rise:.2f}" for scene, rise in worse.items())
            print(f"{condition:<9} {method:<11} {len(worse)} of {len(found)}  {text}")


def _show_lost(rows: list[Row], methods: list[str]) -> None:
    """Where a method errs by more than one frame does."""
    if "nearest" not in methods:
        return
    print("\nscenes whose RMS or mean error is above that of `nearest` (RMS, mean: times as much)")
    for condition in dict.fromkeys(row["condition"] for row in rows):
        for method in methods:
            ratios = against_nearest(rows, condition, method)
            worse = [f"{scene} {a:.2f}, {b:.2f}" for scene, (a, b) in ratios.items() if max(a, b) > 1]
            if method != "nearest":
                print(f"{condition:<9} {method:<11} {len(worse)} of {len(ratios)}  {'; '.join(worse)}")


def against_nearest(rows: list[Row], condition: str, method: str) -> dict[str, tuple[float, float]]:
    """RMS and mean error by scene, in units of those of `nearest`."""
    found = {}
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own, one = (pick(rows, scene, condition, m) for m in (method, "nearest"))
        if own and one:
            a, b = (mean(own, name) / mean(one, name) for name in ("rms_all", "mean_all"))
            found[scene] = a, b
    return found
