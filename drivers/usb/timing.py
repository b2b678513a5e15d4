"""When a frame was exposed, and how surely that is known."""

from drivers.usb.profile import Profile, usable

SAMPLES = 4
"""Phase samples of a frame, each exposed for the integration time."""

BULK_RATE = 13 * 512 * 8000
"""Bytes per second that USB 2.0 high speed carries at most: 13 packets of 512 bytes in each of 8000
microframes (USB 2.0, table 5-10)."""


def mid_exposure(
    requested: int, finished: int, integration_time: float | None, profile: Profile
) -> tuple[int, int]:
    """Middle of the exposure and the half-width of the interval that holds it, ns.

    The exposure ends before the shortest possible transfer began, and lasts at least four integration
    times. It begins after the request where the model is known to wait for it; elsewhere the camera may just
    have finished a frame when it was asked.

    Args:
        requested, finished: clock before the trigger and after the last byte, ns.
        integration_time: seconds per sample, None = unknown.
        profile: the camera's.
    """
    half = round(SAMPLES * (integration_time or 0.0) * 1e9 / 2)
    transfer = round(profile.image.frame_bytes / BULK_RATE * 1e9)
    waits = profile.trigger_starts_exposure
    after_request = bool(waits.value) and usable(waits, allow_inferred=False)
    earliest = requested + half if after_request else requested - half
    latest = max(finished - transfer - half, earliest)
    return (earliest + latest) // 2, (latest - earliest + 1) // 2
