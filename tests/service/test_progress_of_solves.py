"""While a burst is fused somebody is told how far the solver is."""

import time

import pytest
from scripted import calibration, frame

from service.cli.poses import _Lines
from service.config.sections import FusionSection
from service.daemon.advance import Advance
from service.errors import HungError
from service.fusion import answering
from service.fusion.job import BurstJob, Iterating
from service.messages.burst import Burst
from service.messages.decoding import Received
from service.messages.events import FrameCaptured, FusionFailed, SolverAdvanced
from service.messages.progress import ScanProgress, SolverProgress
from service.processes.worker import Worker


def test_the_solver_tells_its_iterations_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Iterating] = []
    monkeypatch.setattr(answering, "tell", told.append)
    settings = FusionSection(
        method="lidarboost", upsampling=2, register_poses=False, tolerance=1e-9, max_iterations=100
    )
    job = BurstJob(Burst(0, tuple(frame(k, k * 1000) for k in range(3)), calibration(), 3), settings)
    monkeypatch.setattr(answering, "_BETWEEN_WORDS", 1000.0)
    answering.answering()(job)
    assert told == []
    monkeypatch.setattr(answering, "_BETWEEN_WORDS", 0.0)
    answering.answering()(job)
    assert told
    assert all(one.iteration > 0 and one.objective >= 0 for one in told)


def test_words_on_the_way_do_not_extend_a_deadline() -> None:
    worker = Worker("chatterer", "telling:chattering")
    worker.start()
    try:
        assert worker.ask(0.1, 30.0) == "done"
        began = time.monotonic()
        with pytest.raises(HungError, match=r"no answer within 0\.5 s"):
            worker.ask(60.0, 0.5, renewed=False)
        assert time.monotonic() - began < 20
    finally:
        worker.kill()


def test_the_progress_of_a_scan_holds_that_of_its_solve_until_the_map_is_there() -> None:
    advance = Advance(lambda: 2, lambda: 1)
    solving = SolverAdvanced(SolverProgress(burst=4, iteration=30, objective=2.5, gap=None))
    assert advance.after(solving) is None  # nothing is known of any burst
    captured = advance.after(FrameCaptured(frame(0, burst=4, pose=0), calibration().mount))
    assert captured is not None
    assert captured.solver is None
    told = advance.after(solving)
    assert told is not None
    assert told.solver is not None
    assert (told.captured, told.solver.iteration) == (1, 30)
    over = advance.after(FusionFailed(4, "no light"))
    assert over is not None
    assert (over.solver, over.fusing) == (None, 0)


def test_plain_lines_tell_each_pose_once_and_the_solve_now_and_then(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show = _Lines()
    solver = SolverProgress(burst=0, iteration=30, objective=1234.5678, gap=0.05)
    for told in (
        ScanProgress(poses=2, captured=2),  # the last burst, of long ago
        ScanProgress(poses=2, captured=1),
        ScanProgress(poses=2, captured=2, fusing=1),
        ScanProgress(poses=2, captured=2, fusing=1, solver=solver),
        ScanProgress(poses=2, captured=2, fusing=1, solver=solver),
    ):
        show(Received("scan/progress", told.model_dump(mode="json"), 0))
    assert capsys.readouterr().err.splitlines() == [
        "burst 0: pose 1 of 2",
        "burst 0: pose 2 of 2",
        "burst 0: fusing, iteration 30, objective 1235, gap 0.05",
    ]
