"""When a frame was exposed, and how surely that is known."""

SAMPLES = 4
"""Phase samples of a frame, each exposed for the integration time."""

BULK_RATE = 13 * 512 * 8000
"""Bytes per second that USB 2.0 high speed carries at most: 13 packets of 512 bytes in each of 8000
microframes (USB 2.0, table 5-10)."""


def mid_exposure(
    requested: int, finished: int, shortest: float, longest: float, frame_bytes: int, waits: bool
) -> tuple[int, int]:
    """Middle of the exposure and the half-width of the interval that holds it, ns.

    The exposure ended before the shortest possible transfer began. It began after the request where the
    camera is known to wait for it; elsewhere the camera may just have finished a frame when it was asked.

    Args:
        requested, finished: clock before the request and after the last byte, ns.
        shortest, longest: seconds that the exposure of all samples takes at least and at most.
        frame_bytes: size of the frame on the bus.
        waits: whether the exposure surely begins after the request.
    """
    earliest = requested + round((shortest if waits else -longest) / 2 * 1e9)
    transfer = frame_bytes / BULK_RATE
    latest = max(finished - round((transfer + shortest / 2) * 1e9), earliest)
    return (earliest + latest) // 2, (latest - earliest + 1) // 2
