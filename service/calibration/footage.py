"""What a calibration looks at: recordings, or the camera itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.position import Position
from drivers.recording import open_recording
from service.calibration.board import Board, Sighting, find_board
from service.calibration.intrinsics import is_new
from service.calibration.mount import View
from service.capture.live import filmed, live
from service.capture.motion import Operator
from service.capture.scan import ScanBursts
from service.config.sections import Configuration
from service.errors import CalibrationError
from service.planning.plan import Plan


@dataclass(frozen=True)
class Footage:
    """Frames of one scene, and the calibration that came with them."""

    frames: tuple[Frame, ...]
    calibration: Calibration


def recorded(paths: Sequence[Path]) -> list[Footage]:
    """All frames of each recording, those of each calibration by themselves.

    Raises:
        RecordingError: a file cannot be read or lacks a calibration.
    """
    found = []
    for path in paths:
        recording = open_recording(path)
        for known, frames in groupby(recording.frames(), key=recording.calibration_of):
            found.append(Footage(tuple(frames), known))
    return found


def film(configuration: Configuration, count: int) -> Footage:
    """`count` frames of what the camera sees now, or as many as a recording that is played has."""
    with live(configuration) as grabber:
        return Footage(tuple(filmed(grabber, count)), grabber.rig.calibration)


def find_sightings(
    frames: Iterator[Frame] | Sequence[Frame], board: Board, enough: int, tell: Callable[[int, int], None]
) -> list[Sighting]:
    """Different views of the board, until there are `enough`.

    Args:
        frames: images, one after the other.
        board: what to look for.
        enough: number of views at which to stop.
        tell: called with the number of views and of frames so far, after each frame.
    """
    views: list[Sighting] = []
    for number, frame in enumerate(frames, start=1):
        found = find_board(_amplitude(frame), board)
        if found is not None and is_new(found, views, frame.shape[1]):
            views.append(found)
        tell(len(views), number)
        if len(views) >= enough:
            break
    return views


def find_views(frames: Sequence[Frame], board: Board) -> list[View]:
    """The board at each pose of the stage, the frames of a pose averaged; poses without it are left out."""
    views = []
    ordered = sorted(frames, key=_pose)
    for (pan, tilt), group in groupby(ordered, key=_pose):
        found = find_board(_mean_amplitude(list(group)), board)
        if found is not None:
            views.append(View(Position(pan, tilt), found))
    return views


def turn_around(
    configuration: Configuration, pan: float, tilt: float, repeats: int, operator: Operator
) -> Footage:
    """Frames at a grid of poses that reaches `pan` and `tilt` (radians) to either side of the plan's centre.

    Raises:
        MotionError: nobody consents to homing the stage, or a movement failed.
        CalibrationError: the stage does not move.
        PlanError: a pose beyond the stage's limits.
    """
    with live(configuration, operator) as grabber:
        limits = grabber.rig.stage.limits
        reaches = [
            np.linspace(-1, 1, steps) * reach if low < high and reach > 0 else np.zeros(1)
            for (low, high), reach, steps in ((limits.pan, pan, 5), (limits.tilt, tilt, 3))
        ]
        if all(len(reach) == 1 for reach in reaches):
            raise CalibrationError("the stage cannot turn; configure one that can (stage.backend)")
        centre = Position(np.radians(configuration.plan.pan), np.radians(configuration.plan.tilt))
        k = grabber.rig.calibration.intrinsics
        offsets = [(-k.fy * np.tan(t), -k.fx * np.tan(p)) for t in reaches[1] for p in reaches[0]]
        plan = Plan(np.array(offsets), centre, k)
        plan.check(limits)
        scan = ScanBursts(grabber, plan, configuration.stage.settle, configuration.stage.timeout)
        frames = [frame for number in range(repeats) for frame in scan.take(number).frames]
        return Footage(tuple(frames), grabber.rig.calibration)


def _pose(frame: Frame) -> tuple[float, float]:
    return round(frame.pan, 6), round(frame.tilt, 6)


def _mean_amplitude(frames: Sequence[Frame]) -> NDArray[np.float64]:
    return np.asarray(np.mean([_amplitude(frame) for frame in frames], axis=0), dtype=np.float64)


def _amplitude(frame: Frame) -> NDArray[np.uint16]:
    if frame.amplitude is None:
        raise CalibrationError("the camera gives no amplitude, in which the board could be seen")
    return frame.amplitude
