"""Cells that two surfaces share: which of them has more of the cell."""

import numpy as np
from numba import njit


@njit
def _apart(a, b, turn):  # type: ignore[no-untyped-def]
    """b − a, by the shorter way round the circle."""
    d = b - a
    return d - turn * np.rint(d / turn)


@njit
def _move(step, part, light, light_a, light_b, law):  # type: ignore[no-untyped-def]
    """Where a cell goes from a (0) to b (1); NaN: it stays."""
    pure, sure, dark, faint, error = law
    if pure < part < 1 - pure:
        # α Z_a + β Z_b has α : β = |Z_b| sin(angle to b) : |Z_a| sin(angle to a).
        a, b = light_b * np.sin(abs(step) * (1 - part)), light_a * np.sin(abs(step) * part)
        share, contrast = b / (a + b), min(light_a, light_b) * abs(np.sin(step))
    elif abs(part) <= pure and light_a > dark * light_b and light_b > faint:
        share, contrast = (light_a - light) / (light_a - light_b), light_a - light_b
    elif abs(1 - part) <= pure and light_b > dark * light_a and light_a > faint:
        share, contrast = (light - light_a) / (light_b - light_a), light_b - light_a
    else:
        return np.nan
    doubt = min(max(error / contrast, sure), 0.5)
    return min(max(0.5 + 0.5 * (share - 0.5) / doubt, 0.0), 1.0)


@njit
def _cross(line, lights, turn, level, law):  # type: ignore[no-untyped-def]
    """Where the middle one of five cells goes, from its neighbour a (0) to b (1); NaN: it stays."""
    before, a, here, b, after = line
    step = _apart(a, b, turn)
    most = level * abs(step)
    if not (abs(_apart(before, a, turn)) < most and abs(_apart(b, after, turn)) < most):
        return np.nan
    light_a, light, light_b = lights
    return _move(2 * np.pi / turn * step, _apart(a, here, turn) / step, light, light_a, light_b, law)


@njit(nogil=True, cache=True, error_model="numpy")
def settle(rank, size, distance, amplitude, turn, cut, edge, level, law, out):  # type: ignore[no-untyped-def]
    """out ← the distances, cells across which they step being moved to the side that has more; by a team.

    Args:
        distance, amplitude: (rows, columns), distance from `cut` up to a `turn` more, or NaN.
        edge: the least step; level: the most that either side may rise itself, in units of the step.
        law: (pure, sure, dark, faint, error). The phase of a cell nearer to a side than `pure` of the step
            tells no shares; its light does, where that side is `dark` times as bright as the other and that
            one brighter than `faint`. A cell of which both sides have about a half, by `sure` or what the
            `error` of its light makes of it, goes only part of the way.
        out: (rows, columns), as `distance`.
    """
    rows, columns = distance.shape
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        for j in range(columns):
            out[i, j], most = distance[i, j], edge
            for r, c in ((0, 1), (1, 0)):
                if i < 2 * r or i + 2 * r >= rows or j < 2 * c or j + 2 * c >= columns:
                    continue
                a, b = distance[i - r, j - c], distance[i + r, j + c]
                step = _apart(a, b, turn)
                if not abs(step) > most:
                    continue
                line = distance[i - 2 * r, j - 2 * c], a, distance[i, j], b, distance[i + 2 * r, j + 2 * c]
                lights = amplitude[i - r, j - c], amplitude[i, j], amplitude[i + r, j + c]
                way = _cross(line, lights, turn, level, law)
                if way >= 0:
                    moved, most = a + step * way, abs(step)
                    out[i, j] = moved - turn * np.floor((moved - cut) / turn)
