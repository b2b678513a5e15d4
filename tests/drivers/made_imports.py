"""Files of cameras as other programs write them."""

import struct

import cv2
import numpy as np

from drivers import sr4000_calibration
from drivers.calibration import Intrinsics
from drivers.importers import import_frames
from drivers.importers.bdat import DEPTH, POINTS

STEP = 5.0 / 16384
"""Metres; the SR4000's distance step at 30 MHz."""


def rays(calibration):
    """(3, H, W) unit rays in camera axes."""
    rows, columns = np.mgrid[: calibration.height, : calibration.width].astype(np.float64)
    flat = cv2.undistortPoints(
        np.stack([columns, rows], axis=-1).reshape(-1, 1, 2),
        calibration.intrinsics.matrix,
        np.asarray(calibration.distortion or (0.0,) * 5),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    ).reshape(calibration.height, calibration.width, 2)
    directions = np.stack([flat[..., 0], flat[..., 1], np.ones(flat.shape[:2])])
    return directions / np.linalg.norm(directions, axis=0)


def vendor_points(radius, calibration):
    """x (left), y (up), z (forward, from 10 mm in front of the centre) as the vendor's library gives them."""
    right, down, forward = radius * rays(calibration)
    return -right, -down, forward - 0.010


class Scene:
    """A wall seen at an angle, on the camera's distance steps."""

    images = ("z", "x", "y", "amplitude", "confidence")

    def __init__(self, seed=0, calibration=None):
        random = np.random.default_rng(seed)
        slope = np.linspace(1.2, 4.9, 144 * 176).reshape(144, 176) + random.normal(0, 0.01, (144, 176))
        self.steps = np.round(slope / STEP)
        self.counts = (self.steps * 4).astype(np.uint16)
        self.x, self.y, self.z = vendor_points(self.steps * STEP, calibration or sr4000_calibration())
        self.amplitude = random.integers(0, 3500, (144, 176))
        self.confidence = random.integers(0, 8, (144, 176))
        self.expected = np.where(self.confidence > 0, self.counts, 0)


TITLES = {
    "z": "Calibrated Distance",
    "x": "Calibrated xVector",
    "y": "Calibrated yVector",
    "amplitude": "Amplitude",
    "confidence": "Confidence map",
}


def text(
    scene, milliseconds=31, *, titles="% {}", apart="\t", one_line=False, metres="%.4f", images=Scene.images
):
    """A text frame; `milliseconds` None = without a time."""

    def block(name):
        form = metres if name in "zxy" else "%d"
        rows = [apart.join(form % value for value in row) for row in getattr(scene, name)]
        return titles.format(TITLES[name]) + "\n" + (apart if one_line else "\n").join(rows) + "\n"

    time = ""
    if milliseconds is not None:
        nans = (apart + "nan") * (scene.z.shape[1] - 1)
        time = titles.format("additional data / time stamp [ms]") + f"\n{milliseconds}{nans}\n"
    return "".join(block(name) for name in images) + time


def write_text(path, scene, milliseconds=31, **style):
    path.write_text(text(scene, milliseconds, **style), encoding="ascii")
    return path


def write_bdat(path, scene):
    frame = np.zeros((), POINTS)
    for name in Scene.images:
        frame[name] = getattr(scene, name)
    path.write_bytes(frame.tobytes())
    return path


def write_depth(path, scene):
    """The recorder's newer version: amplitude, then z in mm."""
    frame = np.zeros((), DEPTH)
    frame["amplitude"], frame["z"] = scene.amplitude, np.round(scene.z * 1e3)
    path.write_bytes(frame.tobytes())
    return path


def srs_object(kind, payload):
    return struct.pack("<II", kind, 8 + len(payload)) + payload


def srs_camera(product=0x0074, serial=0x19E13):
    return srs_object(1, struct.pack("<III", product, 0, serial))


def srs_registers(**values):
    """`srs_registers(r2=0xC0)`: the others are 0."""
    registers = bytearray(64)
    for name, value in values.items():
        registers[int(name[1:])] = value
    return srs_object(2, bytes(registers))


def srs_frame(images):
    return srs_object(3, np.asarray(images, "<u2").tobytes())


def write_srs(path, objects, signature=b"srIO", version=1):
    path.write_bytes(signature + struct.pack("<I", version) + b"".join(objects))
    return path


def raw_images(count, shape=(144, 176), images=2):
    """`count` frames of noise."""
    random = np.random.default_rng(3)
    return [random.integers(0, 65536, (images, *shape), np.uint16) for _ in range(count)]


def only(path, options=None):
    (frame,) = import_frames([path], options).frames()
    return frame


def other_camera():
    """An SR4000 whose centre lies elsewhere."""
    return sr4000_calibration().model_copy(
        update={"intrinsics": Intrinsics(fx=250.8, fy=250.8, cx=90.9, cy=71.6)}
    )
