"""While kernels are compiled somebody is told."""

import logging

import pytest
from numba import njit

from service.config.sections import FusionSection
from service.fusion import answering
from service.fusion.answering import Compiling
from service.fusion.local import LocalExecutor
from service.processes.worker import Worker


def test_a_process_says_how_far_it_is_before_it_answers() -> None:
    worker = Worker("teller", "telling:telling")
    worker.start()
    try:
        heard: list[int] = []
        assert worker.ask(3, 30.0, heard.append) == "done"
        assert heard == [0, 1, 2]
        assert worker.ask(2, 30.0) == "done"
    finally:
        worker.kill()


def test_each_kernel_that_is_compiled_is_told_and_none_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Compiling] = []
    monkeypatch.setattr(answering, "tell", told.append)

    @njit
    def inner(x: float) -> float:
        return x + 1

    @njit
    def outer(x: float) -> float:
        return inner(x) + 1

    with answering._compilations_told():
        assert outer(1.0) == 3.0
        assert outer(2.0) == 4.0
    assert told == [Compiling(1)]


@pytest.mark.faults
def test_the_log_says_that_kernels_compile_and_how_far(
    tmp_path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    caplog.set_level(logging.INFO)
    executor = LocalExecutor(FusionSection(method="nearest", register_poses=False))
    assert executor.progress == "loads its kernels"
    executor.ready.result(timeout=300)
    executor.close()
    assert "the fusion compiles its kernels, once on this machine: 1 so far" in caplog.text
