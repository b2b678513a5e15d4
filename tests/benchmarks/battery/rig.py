"""The simulated rig of the battery: a small camera of SR3000 optics, its bursts, and the limit of a scene."""

from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Intrinsics, Mount, sr4000_calibration
from drivers.poses import relative_rotations
from drivers.simulation.render import Renderer
from drivers.simulation.scene import Scene
from drivers.simulation.sensor import GAIN, PHASE_NOISE
from drivers.stage import Position
from service.config.sections import PlanSection
from service.planning.plan import make_plan

Image = NDArray[np.float32]

HEIGHT, WIDTH, FOCAL = 72, 88, 200.0
RANGE, INTEGRATION = 7.5, 0.030
FULL_SCALE = 65535.0
RESOLUTION, POINTING = 0.01, 0.003
"""Degrees: the stage's smallest step, and how far it stops from where it says (σ)."""


@dataclass(frozen=True)
class Condition:
    """Under what a scene is looked at.

    Attributes:
        frames, span, upsampling: N, width of the field of poses in pixels, β.
        noise: factor on the noise of the sensor (1 = 10 mm at 2 m on a reflectivity of 0.6).
        poses: `exact`, `guess` (the stage's angles as a first guess) or `none`.
        wild: part of the samples that show any distance.
        saturation: amplitude in counts from which a sample is lost.
        shot: part of the noise variance at 3,000 counts that grows with the light.
        told: whether the solver is told the noise.
        amplitude: whether the solver is given the amplitude.
        lens: whether the camera has an SR4000's lens, which moves the corners by four pixels, or none.
    """

    frames: int = 15
    span: float = 15.0
    upsampling: int = 4
    noise: float = 1.0
    poses: str = "exact"
    wild: float = 0.0
    saturation: float = FULL_SCALE
    shot: float = 0.0
    told: bool = True
    amplitude: bool = True
    lens: bool = False


@dataclass(frozen=True, eq=False)
class View:
    """A scene as the camera sees it, and its `truth` at each β: (βH, βW) metres, NaN where nothing is."""

    scene: Scene
    camera: Calibration
    renderer: Renderer
    truth: dict[int, Image]


@dataclass(frozen=True, eq=False)
class Burst:
    """Frames (N, H, W), the arguments of `fuse` that go with them, and the exact rotations (N, 3)."""

    distance: Image
    amplitude: Image
    given: dict[str, Any]
    rotations: NDArray[np.float64]
    noise: float


def calibration(scale: int = 1, *, lens: bool = False) -> Calibration:
    """Of the camera, or of one with pixels `scale` times as fine."""
    centre = [(n * scale - 1) / 2 for n in (WIDTH, HEIGHT)]
    optics = Intrinsics(fx=FOCAL * scale, fy=FOCAL * scale, cx=centre[0], cy=centre[1])
    return Calibration(
        width=WIDTH * scale,
        height=HEIGHT * scale,
        intrinsics=optics,
        distortion=sr4000_calibration().distortion if lens else (),
        source="battery",
    )


def look(scene: Scene, factors: tuple[int, ...], *, lens: bool = False) -> View:
    """The scene with its truth at each β."""
    camera = calibration(lens=lens)
    renderer = Renderer(scene, camera)
    rest = Position(0.0, 0.0)
    truth = {factor: renderer.truth(rest, factor, 1.0).distance for factor in factors}
    return View(scene, camera, renderer, truth)


def limit(view: View, factor: int) -> Image:
    """What a noise-free camera of the fused resolution measures."""
    fine = Renderer(view.scene, calibration(factor, lens=bool(view.camera.distortion)))
    real, imaginary = fine.correlations([Position(0.0, 0.0)] * 4, RANGE)[:2]
    lit = real**2 + imaginary**2 > 0
    angle = np.where(lit, np.arctan2(imaginary, real) % (2 * np.pi), np.nan)
    return (angle * RANGE / (2 * np.pi)).astype(np.float32)


def capture(view: View, condition: Condition, seed: int) -> Burst:
    """A burst by the camera of `view`; the same seed, the same frames."""
    random = np.random.default_rng(seed)
    camera = view.camera
    plan = make_plan(
        PlanSection(span=condition.span),
        condition.frames,
        camera.intrinsics,
        upsampling=condition.upsampling,
        resolution=radians(RESOLUTION),
    )
    said = np.array([(pose.pan, pose.tilt) for pose in plan.poses])
    true = said + random.normal(0, radians(POINTING), said.shape)
    true[0] = said[0]
    phasors = np.stack([_received(view.renderer, pan, tilt) for pan, tilt in true])
    deviation = condition.noise * PHASE_NOISE
    spread = np.hypot(deviation, deviation * np.sqrt(condition.shot * np.abs(phasors) / 3000))
    phasors += spread * (random.normal(size=phasors.shape) + 1j * random.normal(size=phasors.shape))
    distance = (np.angle(phasors) % (2 * np.pi)) * RANGE / (2 * np.pi)
    amplitude = np.abs(phasors)
    hit = random.random(distance.shape) < condition.wild
    distance[hit] = random.uniform(0.3, 7, int(hit.sum()))
    distance[amplitude >= condition.saturation] = np.nan
    turns = relative_rotations(true, Mount())
    noise = deviation * RANGE / (2 * np.pi)
    given: dict[str, Any] = {"intrinsics": camera.intrinsics.matrix, "ambiguity_range": RANGE}
    if camera.distortion:
        given["distortion"] = camera.distortion
    if condition.told:
        given["noise"] = noise if condition.amplitude else noise / float(np.median(amplitude))
    if condition.amplitude:
        given["amplitude"] = amplitude.astype(np.float32)
    if condition.poses == "exact":
        given["rotations"] = turns
    elif condition.poses == "guess":
        given["initial"] = relative_rotations(said, Mount())
    given["distance"] = distance.astype(np.float32)
    return Burst(given["distance"], amplitude.astype(np.float32), given, turns, noise)


def _received(renderer: Renderer, pan: float, tilt: float) -> NDArray[np.complex128]:
    real, imaginary = renderer.correlations([Position(float(pan), float(tilt))] * 4, RANGE)[:2]
    return GAIN * INTEGRATION * (real + 1j * imaginary)


BASE = Condition()
CONDITIONS: dict[str, Condition] = {
    "base": BASE,
    "noise/2": replace(BASE, noise=0.5),
    "noise/4": replace(BASE, noise=0.25),
    "noise/16": replace(BASE, noise=1 / 16),
    "noise*2": replace(BASE, noise=2.0),
    "noise*4": replace(BASE, noise=4.0),
    "N=4": replace(BASE, frames=4),
    "N=8": replace(BASE, frames=8),
    "N=30": replace(BASE, frames=30),
    "N=60": replace(BASE, frames=60),
    "span=1": replace(BASE, span=1.0),
    "span=30": replace(BASE, span=30.0),
    "x2": replace(BASE, upsampling=2),
    "x8": replace(BASE, upsampling=8),
    "guess": replace(BASE, poses="guess"),
    "estimated": replace(BASE, poses="none"),
    "wild": replace(BASE, wild=0.002),
    "saturation": replace(BASE, saturation=2500.0),
    "shot": replace(BASE, shot=1.0),
    "untold": replace(BASE, told=False),
    "dim": replace(BASE, amplitude=False),
    "lens": replace(BASE, lens=True),
}
"""By name; all but one field are those of `base`. `untold`: the noise is estimated; `dim`: no amplitude."""
