"""Records a simulated scan: poses by the plan, in simulated time, with the truth of the first one."""

import hashlib
import io
from collections.abc import Callable
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.backends import make_camera, make_stage
from drivers.clock import VirtualClock
from drivers.frame import Frame
from drivers.poses import camera_rotation
from drivers.recording import RecordingWriter, attachments, recording_head
from drivers.simulated import SimulatedCamera, SimulatedStage
from drivers.simulation.board import Chessboard, board_views, shown
from drivers.simulation.render import Truth
from drivers.simulation.scene import Surface
from service.config.sections import Configuration
from service.planning.plan import Plan, make_plan

EPOCH = 1_767_225_600 * 10**9
"""1 January 2026 0:00 UTC: simulated time begins there, so that equal commands give equal frames."""


STORED_STEP = 2.0**-14
"""m; the truth in a recording is rounded to it: ±0.03 mm, a hundredth of the error of a fused map."""


class SimulationSummary(BaseModel):
    """What `lidarboost simulate` wrote."""

    model_config = ConfigDict(frozen=True)

    path: Path
    scene: str
    frames: int
    bursts: int
    size: int = Field(description="Bytes.")
    nearest: float = Field(description="Metres, over the reference view.")
    farthest: float = Field(description="Metres, over the reference view.")
    median_amplitude: float = Field(description="Counts, of the first frame.")
    rejected: float = Field(description="Share of pixels of the first frame without a distance.")
    pan: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")
    tilt: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")

    def __str__(self) -> str:
        bursts = f", {self.bursts} bursts" if self.bursts > 1 else ""
        return (
            f"{self.path}: {self.frames} frames{bursts} of scene {self.scene}, {self.size / 1e6:.2f} MB\n"
            f"  distances {self.nearest:.2f} to {self.farthest:.2f} m, median amplitude "
            f"{self.median_amplitude:.0f} counts, {100 * self.rejected:.1f} % of pixels rejected\n"
            f"  pan {self.pan[0]:.2f}° to {self.pan[1]:.2f}°, tilt {self.tilt[0]:.2f}° to {self.tilt[1]:.2f}°"
        )


def record_simulation(
    configuration: Configuration, path: Path, bursts: int, advance: Callable[[], None], views: bool = False
) -> SimulationSummary:
    """Take the configured plan `bursts` times and write a recording; nothing is left of one that fails.

    Where the camera does not know its true calibration, that is stored beside the one it knows.

    Args:
        configuration: camera and stage backends `simulated`; goes into the recording.
        path: where the recording goes.
        bursts: times that the plan is taken.
        advance: called after each frame.
        views: show the board (scene `board`) in another pose for each burst.

    Raises:
        PlanError: a pose that the stage cannot reach.
        DriverError: options or settings that the devices refuse, or a file that cannot be written.
    """
    clock = VirtualClock(EPOCH)
    stage = make_stage("simulated", configuration.stage.options, clock)
    camera = make_camera("simulated", configuration.camera.options, clock)
    assert isinstance(stage, SimulatedStage)
    assert isinstance(camera, SimulatedCamera)
    camera.mount_on(stage)
    upsampling = configuration.fusion.upsampling
    with stage, camera:
        if configuration.camera.settings is not None:
            camera.settings = configuration.camera.settings.over(camera.settings)
        calibration = camera.calibration
        plan = make_plan(
            configuration.plan,
            configuration.fusion.frames,
            calibration.intrinsics,
            upsampling=upsampling,
            resolution=radians(configuration.stage.resolution),
        )
        plan.check(stage.limits)
        settings = tomli_w.dumps(configuration.model_dump(mode="json", exclude_none=True))
        head = recording_head(
            source=camera.capabilities.source,
            camera_model=camera.capabilities.model,
            camera_serial=camera.capabilities.serial,
            rig="simulation",
            # Of the configuration, so that equal commands give equal files.
            run_id=hashlib.sha256(settings.encode()).hexdigest()[:32],
            frames_per_burst=len(plan),
            calibration=calibration,
            configuration=settings,
        )
        with RecordingWriter(path, head.metadata, whole=True) as writer:
            head.attach_to(writer, clock.now())
            writer.write_calibration(calibration, clock.now())
            if not camera.options.calibrated:
                true = camera.true_calibration.to_toml().encode()
                writer.attach(attachments.TRUE_CALIBRATION, true, "application/toml", EPOCH)
            shows = _board_views(camera, bursts) if views else None
            kept: list[Frame] = []
            for burst in range(bursts):
                if shows is not None:
                    camera.show(shows[burst])
                for pose in range(len(plan)):
                    frame = _take(camera, stage, plan, burst, pose, configuration.stage.settle)
                    writer.write_frame(frame, calibration.mount)
                    if not kept:
                        truth = camera.truth(upsampling, stage.pose_at(frame.timestamp))
                    kept.append(frame)
                    advance()
            writer.attach(attachments.TRUTH, _packed(truth), "application/octet-stream", EPOCH)
            writer.attach(attachments.THUMBNAIL, _thumbnail(kept[0], truth), "image/png", EPOCH)
    return _summary(path, camera.options.scene, bursts, kept, truth)


def _board_views(camera: SimulatedCamera, count: int) -> list[list[Surface]]:
    """The board in so many poses, each as the camera sees it at rest."""
    board = Chessboard(*camera.options.board, camera.options.square)
    true = camera.true_calibration
    looking, centre = camera_rotation(0.0, 0.0, true.mount), np.asarray(true.mount.lever_arm)
    return [shown(board, pose.seen_from(looking, centre)) for pose in board_views(board, count, true)]


def _take(
    camera: SimulatedCamera, stage: SimulatedStage, plan: Plan, burst: int, pose: int, settle: float
) -> Frame:
    """One frame at one pose; the camera is triggered once the stage stands still, so none is stale."""
    target = plan.poses[pose]
    stage.move_to(target.pan, target.tilt)
    stage.wait()
    stage.clock.sleep(settle)
    camera.start()
    frame = camera.grab()
    camera.stop()
    reported = stage.position
    return replace(frame, pan=reported.pan, tilt=reported.tilt, burst=burst, pose=pose)


def _packed(truth: Truth) -> bytes:
    """The truth as a compressed .npz, rounded to `STORED_STEP` and whole counts, which halves it."""
    buffer = io.BytesIO()
    steps = np.float32(1 / STORED_STEP)
    np.savez_compressed(
        buffer,
        distance=np.rint(truth.distance * steps) / steps,
        depth=np.rint(truth.depth * steps) / steps,
        amplitude=np.rint(truth.amplitude),
    )
    return buffer.getvalue()


def _thumbnail(frame: Frame, truth: Truth) -> bytes:
    """PNG of the first frame's amplitude and, below it, the true distance in colours, near = red."""
    import cv2

    height, width = frame.shape
    amplitude = _amplitude(frame)
    light = np.sqrt(amplitude / max(1.0, float(np.percentile(amplitude, 99))))
    grey = cv2.cvtColor((255 * np.clip(light, 0, 1)).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    near, far = np.nanpercentile(truth.distance, (1, 99))
    share = np.nan_to_num((far - truth.distance) / max(1e-6, far - near), nan=0.0)
    coloured = cv2.applyColorMap((255 * np.clip(share, 0, 1)).astype(np.uint8), cv2.COLORMAP_TURBO)
    small = cv2.resize(coloured, (width, height), interpolation=cv2.INTER_NEAREST)
    return cv2.imencode(".png", np.vstack([grey, small]))[1].tobytes()


def _amplitude(frame: Frame) -> NDArray[np.uint16]:
    assert frame.amplitude is not None, "a simulated camera gives one"
    return frame.amplitude


def _summary(path: Path, scene: str, bursts: int, frames: list[Frame], truth: Truth) -> SimulationSummary:
    pans = np.degrees([frame.pan for frame in frames])
    tilts = np.degrees([frame.tilt for frame in frames])
    return SimulationSummary(
        path=path,
        scene=scene,
        frames=len(frames),
        bursts=bursts,
        size=path.stat().st_size,
        nearest=float(np.nanmin(truth.distance)),
        farthest=float(np.nanmax(truth.distance)),
        median_amplitude=float(np.median(_amplitude(frames[0]))),
        rejected=float(np.mean(~frames[0].valid)),
        pan=(float(pans.min()), float(pans.max())),
        tilt=(float(tilts.min()), float(tilts.max())),
    )
