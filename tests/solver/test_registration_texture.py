"""Registration where texture looks alike in many places."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "battery"))

from parts import checked, printed, scene, stairs, wall
from rig import BASE, FOCAL, RANGE, capture, look

from solver.registration import register


def registered(made, poses):
    burst = capture(look(made, (4,)), replace(BASE, poses=poses), seed=0)
    found = register(
        burst.distance,
        burst.amplitude,
        intrinsics=burst.given["intrinsics"],
        initial=burst.given.get("initial"),
        ambiguity_range=RANGE,
    )
    return found, FOCAL * np.abs(found.rotations - burst.rotations)[:, :2].max()


@pytest.mark.parametrize(
    "made",
    [
        scene("print", wall(2.0, texture=printed(0.3))),
        scene("stairs", stairs(1.9, 0.04, 7, printed(0.12, 4), lying=False)),
    ],
    ids=lambda made: made.name,
)
def test_text_is_placed_without_a_guess_and_no_frame_rejected(made):
    found, off = registered(made, "none")
    assert not found.rejected
    assert off < 0.05


def test_checks_stay_where_the_stage_says():
    """Each of their cells looks like the next but one."""
    found, off = registered(scene("checks", wall(2.0, texture=checked(0.3, 0.025))), "guess")
    assert not found.rejected
    assert off < 0.05


@pytest.mark.parametrize("period", [8, 10])
def test_checks_without_a_guess_are_judged_where_they_are_sharp(period):
    """Eight frames within a quarter of a period, of cells that smaller images alias."""
    random, rays, margin = np.random.default_rng(0), 8, 4
    rows, columns = ((np.arange((n + 2 * margin) * rays) + 0.5) / rays - margin - 0.5 for n in (40, 56))
    light = (
        3000
        / (1 + np.floor(2 * columns / period) % 2)
        * (1 - 0.2 * (np.floor(2 * rows / period)[:, None] % 2))
    )
    field = light * np.exp(2j * np.pi * (2 + 0.002 * rows[:, None]) / RANGE)
    steps = np.rint(random.uniform(-2, 2, (8, 2)) * rays).astype(int)
    steps[0] = 0
    frames = []
    for down, right in margin * rays + steps:
        part = field[down : down + 40 * rays, right : right + 56 * rays]
        frames.append(part.reshape(40, rays, 56, rays).mean((1, 3)))
    noises = random.normal(size=(2, 8, 40, 56))
    phasors = np.array(frames) + 25 * (noises[0] + 1j * noises[1])
    distance = np.mod(np.angle(phasors), 2 * np.pi) * RANGE / (2 * np.pi)
    found = register(distance, np.abs(phasors), ambiguity_range=RANGE)
    assert len(found.rejected) <= 1
    assert np.abs(found.shifts - steps / rays).max() < 0.2
