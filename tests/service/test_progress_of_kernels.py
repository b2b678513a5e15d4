"""While kernels are compiled somebody is told."""

import logging
import re

import pytest

from service.config.sections import FusionSection
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


@pytest.mark.faults
@pytest.mark.timeout(600)
def test_the_log_says_that_kernels_compile_and_how_far(
    tmp_path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    caplog.set_level(logging.INFO)
    executor = LocalExecutor(FusionSection(method="nearest"))
    assert executor.progress == "loads its kernels"
    executor.ready.result(timeout=590)
    executor.close()
    assert re.search(r"the fusion compiles its kernels, once on this machine: 1 of \d\d\n", caplog.text)
