"""The calibration that a `.srs` stream carries: the vendor's XML, or the image of a camera's flash."""

import re
from pathlib import Path
from xml.etree import ElementTree

from drivers.calibration import Calibration, Intrinsics
from drivers.importers.exposure import Findings

_DECLARATION = re.compile(rb"<\?xml.*?\?>", re.DOTALL)
"""One of the vendor's own files has two, which no parser takes."""


def geometry(
    focal_length: float,
    pitch: tuple[float, float],
    centre: tuple[float, float],
    shape: tuple[int, int],
    source: str,
) -> Calibration:
    """Optics from metres and pixels.

    Args:
        focal_length: metres.
        pitch: width and height of a pixel, metres.
        centre: column and row of the principal point, taken to count from 0 at the first pixel's centre.
        shape: (rows, columns).
        source: where the figures come from.

    Raises:
        ValueError: figures that no camera has.
    """
    return Calibration(
        width=shape[1],
        height=shape[0],
        intrinsics=Intrinsics(
            fx=focal_length / pitch[0], fy=focal_length / pitch[1], cx=centre[0], cy=centre[1]
        ),
        source=source,
    )


def stored_calibration(
    payload: bytes | None, shape: tuple[int, int], path: Path, findings: Findings
) -> Calibration | None:
    """The optics of a calibration object, or None where there is none that can be read.

    Its fixed pattern is not applied: which way it is to be subtracted is not documented.
    """
    if payload is None:
        return None
    sensor = _sensor(payload)
    if sensor is None:
        findings.note(f"{path.name}: its calibration is no XML that is known; nominal optics are kept")
        return None
    if sensor.find(".//*[@FixPatternNoise]") is not None:
        findings.note(
            f"{path.name}: the fixed pattern of its calibration is not applied: its sign is not public"
        )
    try:
        columns, rows = _pair(sensor, "PixNum")
        pitch = _pair(sensor, "PixSz")
        optics = sensor.find("Geometry")
        if optics is None or (rows, columns) != shape:
            raise ValueError("no geometry, or of another sensor")
        centre = _pair(optics, "OptCtr")
        return geometry(float(optics.attrib["Focal"]), pitch, centre, shape, f"calibration in {path.name}")
    except (KeyError, ValueError, ZeroDivisionError) as error:
        said = " ".join(str(error).split())[:80]
        findings.note(f"{path.name}: its calibration gives no optics ({said}); nominal optics are kept")
        return None


def _sensor(payload: bytes) -> ElementTree.Element | None:
    try:
        return ElementTree.fromstring(_DECLARATION.sub(b"", payload).strip(b"\0 \r\n\t")).find("Sensor")
    except (ElementTree.ParseError, ValueError, LookupError):
        return None


def _pair(element: ElementTree.Element, name: str) -> tuple[float, float]:
    first, second = element.attrib[name].split()
    return float(first), float(second)
