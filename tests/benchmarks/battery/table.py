"""The battery's rows as text."""

from collections.abc import Iterable
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
            print(f"{kind}, {method:<11}" + _ratios(rows, condition, method, names))


def _kinds(scenes: list[str], tuned: set[str]) -> list[tuple[str, list[str]]]:
    kinds = (
        ("reported", [s for s in scenes if s not in tuned]),
        ("tuning", [s for s in scenes if s in tuned]),
    )
    return [(kind, names) for kind, names in kinds if names]


def _ratios(rows: list[Row], condition: str, method: str, scenes: list[str]) -> str:
    """Geometric means of the ratios to the limit, and means of other columns."""
    pairs = [(pick(rows, s, condition, method), pick(rows, s, condition, "limit")) for s in scenes]
    pairs = [(own, limit) for own, limit in pairs if own]
    wide = [(own, limit) for own, limit in pairs if mean(limit, "rms_all") > FLOOR]
    if not pairs:
        return " –"
    out = " ratio to the limit"
    for name in ("rms_all", "mean_all"):
        out += f" {geometric([mean(own, name) / mean(limit, name) for own, limit in wide]):.2f}"
    out += f" over {len(wide)} scenes;"
    for name in ("mean_away", "mean_edges", "mean_borders"):
        values = [mean(own, name) for own, _ in pairs]
        out += f" {name.split('_')[1]} {np.nanmean(values):.1f} mm"
    inside = [mean(own, "within_away") for own, _ in pairs]
    near = [mean(own, "within_edges") for own, _ in pairs]
    return out + (
        f"; <1σ away {100 * np.nanmin(inside):.0f}–{100 * np.nanmax(inside):.0f} %, "
        f"<2σ edges median {100 * np.nanmedian(near):.0f} %"
    )


def _show_consistency(rows: list[Row], methods: list[str]) -> None:
    """Where better data make a map worse."""
    print("\nconsistency: scenes whose RMS rises by over 2 % against base (by how much at most)")
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    for condition in dict.fromkeys(row["condition"] for row in rows):
        if condition not in ("noise/2", "noise/4", "noise/16", "N=30", "N=60"):
            continue
        for method in methods:
            rises = {}
            for scene in scenes:
                before, after = (pick(rows, scene, c, method) for c in ("base", condition))
                if before and after:
                    rises[scene] = mean(after, "rms_all") / mean(before, "rms_all")
            worse = {scene: rise for scene, rise in rises.items() if rise > 1.02}
            text = ", ".join(
                f"{scene} {rise:.2f}" for scene, rise in sorted(worse.items(), key=lambda x: -x[1])
            )
            print(f"{condition:<9} {method:<11} {len(worse)} of {len(rises)}  {text}")


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
