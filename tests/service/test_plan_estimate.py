from math import radians

import numpy as np
import pytest

from drivers.calibration import Mount, sr3000_calibration
from drivers.position import Limits
from drivers.simulated import SimulatedStage
from service.config.sections import PlanSection
from service.planning.estimate import estimate_plan
from service.planning.plan import make_plan

CAMERA = sr3000_calibration()


def estimate(mount=CAMERA.mount, frames=16, nearest=1.0, farthest=3.0, **plan):
    plan = make_plan(PlanSection(**plan), frames, CAMERA.intrinsics)
    calibration = CAMERA.model_copy(update={"mount": mount})
    return plan, estimate_plan(plan, calibration, 4, nearest, farthest)


def test_shifts_are_those_that_the_plan_intends():
    plan, found = estimate(span=1.0)
    assert found.shifts == pytest.approx(plan.offsets, abs=2e-3)
    assert found.coverage >= 0.9
    assert found.rows == found.columns == 1.0
    assert found.warnings == ()


def test_pan_only_leaves_the_rows_unresolved_and_says_so():
    _, found = estimate(span=1.0, axes="pan")
    assert found.rows == 0.25
    assert found.columns == 1.0
    assert found.coverage == 0.25
    (warning,) = found.warnings
    assert warning.startswith("the rows stay unresolved")


def test_rolled_camera_resolves_rows_with_pan_alone():
    _, found = estimate(mount=Mount(rotation=(0.0, 0.0, radians(45))), span=1.4, axes="pan")
    assert found.rows == found.columns == 1.0
    assert found.warnings == ()


def test_parallax_of_a_lever_arm():
    # 0.1 m, turned by 1 pixel: 0.1 pixels at 1 m, a third of that at 3 m.
    plan, found = estimate(mount=Mount(lever_arm=(0.0, 0.0, 0.1)), frames=2, span=2.0, axes="pan")
    turned = float(np.ptp(plan.offsets[:, 1]))
    assert turned == pytest.approx(0.5)
    assert found.parallax_nearest == pytest.approx(0.1 * turned, rel=0.01)
    assert found.parallax_farthest == pytest.approx(0.1 / 3 * turned, rel=0.01)
    assert found.parallax == pytest.approx(0.0667 * turned, rel=0.01)
    assert "parallax 0.050 pixels at 1 m, 0.017 at 3 m" in str(found)


def test_parallax_beyond_a_tenth_of_a_pixel_is_warned_of():
    _, small = estimate(mount=Mount(lever_arm=(0.05, 0.0, 0.05)), span=1.0)
    _, large = estimate(mount=Mount(lever_arm=(0.05, 0.0, 0.15)), span=3.0)
    assert small.warnings == ()
    (warning,) = large.warnings
    assert "make plan.span smaller" in warning


def test_camera_on_the_axes_has_no_parallax():
    _, found = estimate(span=3.0)
    assert found.parallax_nearest == 0.0


def test_a_stage_that_only_pans_gets_a_plan_it_can_run(caplog):
    from service.capture.configured import make_rig
    from service.config.sections import CameraSection, Configuration, StageSection
    from service.daemon.modes import planned

    class PanOnly(SimulatedStage):
        def _limits(self):
            return Limits(pan=super()._limits().pan, tilt=(0.0, 0.0))

    configuration = Configuration(
        camera=CameraSection(backend="simulated", options={"scene": "plane"}),
        stage=StageSection(backend="simulated"),
    )
    rig = make_rig(configuration)
    rig.stage = PanOnly()
    rig.open()
    try:
        plan = planned(configuration, rig, 15)
    finally:
        rig.close()
    assert {pose.tilt for pose in plan.poses} == {0.0}
    assert len({pose.pan for pose in plan.poses}) == 15
    assert "the rows stay unresolved" in caplog.text
