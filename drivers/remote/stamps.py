"""Times of images that others stamp."""

import logging

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

_OTHER_CLOCK = 10 * 10**9
"""ns between a stamp and the host's clock from which the stamps are of another one."""

ARRIVAL = 50_000_000
"""ns by which an image may have come after it was exposed, where only its arrival is known."""

_log = logging.getLogger(__name__)


class Stamps:
    """Times of the host's clock for stamps; those of another clock are passed over for the arrival."""

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._is_told = False

    def time(self, stamp: int, arrived: int) -> tuple[int, int]:
        """ns since the epoch and their uncertainty."""
        if abs(arrived - stamp) < _OTHER_CLOCK:
            return stamp, 0
        if not self._is_told:
            self._is_told = True
            why = "0" if stamp == 0 else f"{(arrived - stamp) / 1e9:.1f} s off this host's clock"
            _log.warning("%s: the stamps are %s; the times of arrival are taken", self._origin, why)
        return arrived, ARRIVAL


def stamp_of(payload: bytes) -> int:
    """The timestamp of a foxglove.RawImage, ns."""
    image = RawImage()
    image.ParseFromString(payload)
    return image.timestamp.ToNanoseconds()
