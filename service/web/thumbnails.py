"""The last bursts as small pictures, each with its report."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WIDTH = 176
"""Columns of a thumbnail at most."""

_KEPT = 12
_WAITING = 32
"""Pictures and reports that wait for their other half: some seconds of a stream."""


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """One burst.

    Attributes:
        key: of its URL.
        picture: PNG.
        report: the payload of `fused/report`.
        shape: rows and columns of the map.
    """

    key: str
    picture: bytes
    report: dict[str, Any]
    shape: tuple[int, int]

    def told(self) -> dict[str, Any]:
        """As a browser is told of it."""
        return {
            "key": self.key,
            "url": f"/bursts/{self.key}.png",
            "burst": self.report.get("burst"),
            "time": int(self.key) / 1e9,
            "height": self.shape[0],
            "width": self.shape[1],
            "report": self.report,
        }


class Thumbnails:
    """Joins maps and reports by their time, whichever comes first, and keeps the last ones."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, Thumbnail] = OrderedDict()
        self._pictures: OrderedDict[int, tuple[bytes, tuple[int, int]]] = OrderedDict()
        self._reports: OrderedDict[int, dict[str, Any]] = OrderedDict()

    @property
    def newest_first(self) -> list[Thumbnail]:
        return list(reversed(self._kept.values()))

    def picture(self, key: str) -> bytes | None:
        """The PNG of a burst; None = it is not kept any more."""
        found = self._kept.get(key)
        return None if found is None else found.picture

    def add_picture(self, timestamp: int, picture: bytes, shape: tuple[int, int]) -> Thumbnail | None:
        """Take a map's picture; the thumbnail, where its report is here already."""
        self._pictures[timestamp] = picture, shape
        return self._joined(timestamp)

    def add_report(self, timestamp: int, report: dict[str, Any]) -> Thumbnail | None:
        """Take a report; the thumbnail, where its map's picture is here already."""
        self._reports[timestamp] = report
        return self._joined(timestamp)

    def _joined(self, timestamp: int) -> Thumbnail | None:
        for waiting in (self._pictures, self._reports):
            while len(waiting) > _WAITING:
                waiting.popitem(last=False)
        if timestamp not in self._pictures or timestamp not in self._reports:
            return None
        picture, shape = self._pictures.pop(timestamp)
        report = self._reports.pop(timestamp)
        made = Thumbnail(str(timestamp), picture, report, shape)
        self._kept[made.key] = made
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return made


def drawn(depth: NDArray[np.float32]) -> bytes:
    """A PNG of a depth map (H, W), near things red and far ones blue, unknown ones transparent."""
    import cv2

    step = -(-depth.shape[1] // _WIDTH)
    small = depth[::step, ::step]
    known = np.isfinite(small)
    low, high = np.percentile(small[known], (2, 98)) if known.any() else (0.0, 1.0)
    place = np.where(known, (high - small) / max(high - low, 1e-6), 0.0).clip(0, 1)
    colours = cv2.applyColorMap((place * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    done, png = cv2.imencode(".png", np.dstack([colours, known.astype(np.uint8) * 255]))
    assert done
    return png.tobytes()
