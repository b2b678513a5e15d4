"""Plans of poses: phases, spans, limits."""

from math import radians

import numpy as np
import pytest

from drivers import Limits, sr3000_calibration
from service.config.sections import PlanSection
from service.errors import PlanError
from service.planning.plan import coverage, lattice, make_plan

INTRINSICS = sr3000_calibration().intrinsics


@pytest.mark.parametrize("frames", [1, 2, 8, 15, 16, 20, 31])
@pytest.mark.parametrize("span", [0.5, 1.0, 3.0, 15.0])
@pytest.mark.parametrize("resolution", [0.0, radians(0.05)])
def test_poses_begin_at_the_centre_and_stay_within_the_span(
    frames: int, span: float, resolution: float
) -> None:
    plan = make_plan(PlanSection(span=span), frames, INTRINSICS, resolution=resolution)
    assert len(plan) == len(plan.poses) == frames
    assert np.all(plan.offsets[0] == 0)
    assert (plan.poses[0].pan, plan.poses[0].tilt) == (0, 0)
    assert np.abs(plan.offsets).max() <= span / 2 + 1e-9


@pytest.mark.parametrize(("frames", "least"), [(8, 0.5), (15, 0.9), (16, 1.0), (20, 1.0)])
def test_phases_are_as_even_as_their_number_allows(frames: int, least: float) -> None:
    plan = make_plan(PlanSection(span=3.0), frames, INTRINSICS)
    assert coverage(plan.offsets, 4) >= least
    closest = min(
        np.hypot(*(d - np.round(d))) for k in range(frames) for d in (plan.offsets[k] - plan.offsets[:k])
    )
    # A hexagonal arrangement, the best there is, keeps 1.07 / √N; random phases come to about 0.5 / N.
    assert closest > 0.8 / np.sqrt(frames)


def test_poses_lie_on_the_steps_of_the_stage_and_still_spread_their_phases() -> None:
    step = radians(0.05) * INTRINSICS.fx
    plan = make_plan(PlanSection(span=3.0), 15, INTRINSICS, resolution=radians(0.05))
    assert np.allclose(plan.offsets / step, np.round(plan.offsets / step), atol=1e-9)
    assert coverage(plan.offsets, 4) > 0.8


def test_a_wider_span_is_used() -> None:
    plan = make_plan(PlanSection(span=15.0), 15, INTRINSICS)
    assert np.all(np.ptp(plan.offsets, axis=0) > 10)


def test_angles_follow_the_definition_of_a_shift() -> None:
    plan = make_plan(PlanSection(span=3.0, pan=10.0, tilt=-5.0), 15, INTRINSICS)
    for pose, (dy, dx) in zip(plan.poses, plan.offsets, strict=True):
        assert pose.pan - radians(10) == pytest.approx(-dx / INTRINSICS.fx, rel=1e-3)
        assert pose.tilt - radians(-5) == pytest.approx(-dy / INTRINSICS.fy, rel=1e-3)


def test_pan_only_and_standing_still() -> None:
    plan = make_plan(PlanSection(axes="pan"), 8, INTRINSICS)
    assert not plan.offsets[:, 0].any()
    assert len(set(np.round(plan.offsets[:, 1] % 1, 6))) == 8
    assert not make_plan(PlanSection(), 8, INTRINSICS, still=True).moves


def test_a_pose_out_of_reach_is_named_before_anything_moves() -> None:
    plan = make_plan(PlanSection(pan=20.0), 4, INTRINSICS)
    with pytest.raises(PlanError, match=r"pose 0 .* pan 20\.000° is outside"):
        plan.check(Limits(pan=(-0.1, 0.1), tilt=(-0.1, 0.1)))


def test_coverage_counts_cells() -> None:
    assert coverage([[0, 0]], 4) == 1 / 16
    assert coverage([[0, 0], [0.01, 3.0]], 4) == 1 / 16
    cells = (np.arange(4) + 0.5) / 4 - 0.5
    assert coverage([(dy, dx) for dy in cells for dx in cells], 4) == 1


def test_the_lattice_is_one_on_the_torus() -> None:
    points = lattice(15, 4)
    differences = {tuple(np.round((p - points[1]) % 1, 6)) for p in points}
    assert differences == {tuple(np.round((p - points[2]) % 1, 6)) for p in points}
