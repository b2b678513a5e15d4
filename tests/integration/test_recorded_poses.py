"""The bundled recordings are registered to a hundredth of a pixel, whatever is known of their frames."""

import functools
import tomllib
from pathlib import Path

import numpy as np
import pytest

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.poses import relative_rotations
from drivers.recording import open_recording
from drivers.simulated import SimulatedStage
from service.config.sections import Configuration
from service.fusion.fuse import stack
from service.jobs.simulate import EPOCH
from solver.geometry.positions import sample_positions
from solver.registration import Track, register

RECORDINGS = Path(__file__).parents[2] / "recordings"


@functools.cache
def recorded(scene):
    """Distance, amplitude, where the camera truly looked, where the stage said, intrinsics, range."""
    recording = open_recording(RECORDINGS / f"{scene}.mcap")
    frames, calibration = list(recording.frames()), recording.calibration
    settings = Configuration.model_validate(tomllib.loads(recording.configuration)).stage
    clock, true = VirtualClock(EPOCH), []
    stage = make_stage("simulated", settings.options, clock)
    assert isinstance(stage, SimulatedStage)
    with stage:  # the same seed misses its targets by the same angles again
        for frame in frames:
            stage.move_to(frame.pan, frame.tilt)
            stage.wait()
            place = stage.pose_at(clock.now())
            true.append((place.pan, place.tilt))
    told = [(frame.pan, frame.tilt) for frame in frames]
    turns, guess = (relative_rotations(angles, calibration.mount) for angles in (true, told))
    distance, amplitude = stack(frames, calibration)
    span = frames[0].ambiguity_range
    return distance, amplitude, turns, guess, calibration.intrinsics.matrix, span


def error(found, turns, shape, intrinsics):
    """RMS of rows and columns that pixels are misplaced by, in pixels."""
    have, want = (
        sample_positions((len(turns), *shape), rotations=r, intrinsics=intrinsics) for r in (found, turns)
    )
    return float(np.sqrt(np.mean((have - want)[1:] ** 2)))


@pytest.mark.parametrize("scene", ["wedges", "objects"])
@pytest.mark.parametrize(
    ("known", "most"), [("distance", 0.02), ("amplitude", 0.015), ("ambiguity range", 0.01)]
)
@pytest.mark.parametrize("guided", [False, True])
def test_a_burst(scene, known, most, guided):
    distance, amplitude, turns, guess, intrinsics, span = recorded(scene)
    found = register(
        distance,
        None if known == "distance" else amplitude,
        intrinsics=intrinsics,
        initial=guess if guided else None,
        ambiguity_range=span if known == "ambiguity range" else None,
    )
    assert not found.rejected
    assert error(found.rotations, turns, distance.shape[1:], intrinsics) < most


@pytest.mark.parametrize(("scene", "most"), [("wedges", 0.01), ("objects", 0.02)])
def test_a_stream_of_distance_alone(scene, most):
    distance, _, turns, guess, intrinsics, _ = recorded(scene)
    track = Track(len(distance), intrinsics)
    for frame, turn in zip(distance, turns, strict=True):
        track.add(frame, None, turn)
    for _ in range(2):
        found = np.stack([track.follow(d, None, g) for d, g in zip(distance, guess, strict=True)])
    assert error(found, turns, distance.shape[1:], intrinsics) < most
