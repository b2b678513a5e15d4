"""How fast the simulated camera delivers: `python tests/benchmarks/simulated_camera.py`.

Printed as JSON: the computing per frame (in virtual time; on the clock and summed over the processor's cores)
at rest, while the stage sweeps (four poses per frame), and with a lever arm; and what a caller gets in real
time at 50 frames/s with a sweeping stage.
"""

import json
import time

from drivers import CameraSettings, make_camera, make_stage
from drivers.clock import Clock, SystemClock, VirtualClock

FAST = CameraSettings(integration_time=0.0047, frame_rate=50)
SWEEP = 0.05
"""Radians to either side, 10 pixels."""


def computed(frames: int, *, sweeping: bool, **options: object) -> dict[str, float]:
    """The work of a frame where time waits for the computer."""
    taken, worked, _ = _run(frames, VirtualClock(10**18), sweeping=sweeping, **options)
    return {
        "frames_per_second": frames / taken,
        "elapsed_ms_per_frame": 1e3 * taken / frames,
        "processor_ms_per_frame": 1e3 * worked / frames,
    }


def delivered(seconds: float) -> dict[str, float]:
    """What arrives in real time."""
    frames = round(50 * seconds)
    taken, _, dropped = _run(frames, SystemClock(), sweeping=True)
    return {"frames_per_second": frames / taken, "dropped": dropped}


def _run(frames: int, clock: Clock, *, sweeping: bool, **options: object) -> tuple[float, float, int]:
    """Seconds elapsed, processor seconds, frames dropped."""
    stage = make_stage("simulated", {"speed": 5.0}, clock)
    camera = make_camera("simulated", {"scene": "wedges", **options}, clock)
    camera.mount_on(stage)
    with stage, camera:
        camera.settings = FAST
        camera.start()
        first = camera.grab()
        begin, worked, side = time.perf_counter(), time.process_time(), SWEEP
        for _ in range(frames):
            if sweeping and abs(stage.position.pan - side) < 1e-3:
                side = -side
            if sweeping:
                stage.move_to(side, 0.0)
            last = camera.grab()
        taken, worked = time.perf_counter() - begin, time.process_time() - worked
    return taken, worked, last.sequence - first.sequence - frames


if __name__ == "__main__":
    print(
        json.dumps(
            {
                "at_rest": computed(200, sweeping=False),
                "sweeping": computed(200, sweeping=True),
                "lever_arm_sweeping": computed(5, sweeping=True, lever_arm=(0.0, 0.0, 0.1)),
                "real_time_sweeping": delivered(5.0),
            },
            indent=2,
        )
    )
