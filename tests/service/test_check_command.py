"""What a burst would give, asked before anything moves."""

from pathlib import Path

import numpy as np
from commanding import configuration, running, stranger
from scripted import frame
from test_commands import hasty_rig

from service.planning.check import exposure_of


def test_a_check_tells_what_a_burst_would_give_and_moves_nothing(tmp_path: Path, endpoint: str) -> None:
    with running(configuration(tmp_path, endpoint), hasty_rig()) as service, stranger(endpoint) as far:
        check = far.ask("cmd/scan", action="check")["check"]
        assert service.rig.stage.moves == []
        assert check["poses"] == 4
        assert 0.7 < check["seconds"] < 3
        assert check["coverage"] == 1.0
        exposure = check["exposure"]
        assert (exposure["saturated"], exposure["dark"]) == (0.0, 0.0)
        assert sum(exposure["histogram"]) == 24
        assert 0 < exposure["noise"] < 0.001
        assert check["advice"] == []
        assert service.daemon.grabber.counts.frames == 0


def test_a_bad_exposure_is_told_with_advice() -> None:
    counts = np.full((4, 6), 20_000, np.uint16)
    amplitude = np.full((4, 6), 2_000, np.uint16)
    amplitude[0, :3], counts[1:3] = 0xFFFF, 0
    exposure = exposure_of([frame(0, counts=counts, amplitude=amplitude)] * 2)
    assert (exposure.saturated, exposure.dark) == (3 / 24, 12 / 24)
