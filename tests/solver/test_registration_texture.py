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
