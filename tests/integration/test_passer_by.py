"""Somebody in one frame of a recording: the map is as without, and the report says what was left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.recording import open_recording
from service.config.sections import FusionSection
from service.fusion.fuse import fuse_burst
from service.jobs.fuse import recorded_bursts
from service.messages.summary import describe, summarize

WEDGES = Path(__file__).parents[2] / "recordings" / "wedges.mcap"


def test_a_passer_by_is_left_out_and_reported() -> None:
    recording = open_recording(WEDGES)
    burst = next(recorded_bursts(recording, FusionSection(), recording.calibration))
    frames = list(burst.frames)
    counts = frames[6].counts.copy()
    counts[50:110, 60:100] = round(65536 / frames[6].ambiguity_range)  # at 1 m
    frames[6] = replace(frames[6], counts=counts)
    errors, lines = [], []
    for seen in (burst, replace(burst, frames=tuple(frames))):
        result = fuse_burst(seen, FusionSection())
        summary = summarize(result, recording.truth)
        assert summary.errors is not None
        errors.append(summary.errors.rms)
        lines.append((result.report.contradicted, describe(summary)))
    assert errors[1] < 1.05 * errors[0]
    assert lines[0][0] < 1e-4
    assert "contradict" not in lines[0][1]
    assert lines[1][0] == pytest.approx(60 * 40 / np.prod((15, 144, 176)), rel=0.1)
    assert "0.6% of the samples contradict the others, or are too far" in lines[1][1]
