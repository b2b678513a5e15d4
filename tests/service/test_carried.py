"""Bursts of frames that carry their poses, as a recording's do."""

import numpy as np
import pytest
from capture_scene import Scene
from scripted import PERIOD, frame

from drivers import DeviceTimeoutError, Frame, RecordingError
from service.messages.burst import Burst


def carried(*bursts: tuple[int | None, int], first: int = 0) -> list[Frame]:
    """Frames of (burst id, how many), numbered on."""
    found: list[Frame] = []
    for burst, count in bursts:
        found += [
            frame(
                first + len(found) + k,
                (len(found) + k) * PERIOD,
                burst=burst,
                pose=None if burst is None else k,
                pan=0.001 * k,
            )
            for k in range(count)
        ]
    return found


def test_recorded_bursts_are_cut_by_their_ids_and_keep_their_poses() -> None:
    scene = Scene(carried=carried((7, 3), (8, 3), (9, 3)))
    bursts = scene.take(9)
    assert [(b.id, len(b.frames), b.missing) for b in bursts] == [(7, 3, 0), (8, 3, 0), (9, 3, 0)]
    assert [f.pan for f in bursts[1].frames] == [0.0, 0.001, 0.002]
    assert scene.stage.moves == []


def test_frames_without_an_id_are_cut_by_number_and_the_last_burst_says_what_it_lacks() -> None:
    bursts = Scene(carried=carried((None, 13)), frames=5).take(9)
    assert [(b.id, len(b.frames), b.missing) for b in bursts] == [(0, 5, 0), (1, 5, 0), (2, 3, 2)]
    assert [(f.burst, f.pose) for f in bursts[2].frames] == [(2, 0), (2, 1), (2, 2)]


def test_a_shorter_last_burst_says_what_it_lacks() -> None:
    bursts = Scene(carried=carried((0, 6), (1, 4))).take(9)
    assert [b.missing for b in bursts] == [0, 2]


def test_a_pause_in_a_recording_is_no_fault() -> None:
    scene = Scene(carried=carried((0, 4)), camera_faults={2: DeviceTimeoutError("due in 3 s")})
    (burst,) = scene.take(9)
    assert len(burst.frames) == 4
    assert scene.counts.lost == 0


def test_frames_that_do_not_fit_together_are_bursts_of_their_own() -> None:
    odd = np.zeros((5, 5), np.uint16)
    scene = Scene(carried=[frame(0, burst=0), frame(1, burst=0, counts=odd, amplitude=odd)])
    with pytest.raises(RecordingError, match=r"5 × 5 pixels; its calibration is for 4 × 6"):
        scene.take(2)
    bursts = Scene(carried=[frame(0, burst=0), frame(1, burst=0, ambiguity_range=5.0)]).take(2)
    assert [[f.ambiguity_range for f in burst.frames] for burst in bursts] == [[7.5], [5.0]]


def test_a_burst_of_frames_that_do_not_fit_together_is_refused() -> None:
    frames = frame(0, burst=0), frame(1, burst=0, ambiguity_range=5.0)
    calibration = Scene(carried=[]).rig.calibration
    with pytest.raises(RecordingError, match=r"mixes ambiguity ranges of 7\.5 m and 5 m"):
        Burst(0, frames, calibration, 2)
