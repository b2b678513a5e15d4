"""What a trace showed, in words for its owner."""

from collections.abc import Iterable, Sequence

from drivers.usb.profile import Profile
from drivers.usb.sessions import Session
from drivers.usb.steps import Step, Write
from drivers.usb.trace import Transfer

MAX_LISTED = 12
"""Values of a register that are listed."""


def uploaded_bytes(steps: Iterable[Step]) -> int:
    """Bytes of bulk data that a sequence sends, register writes aside."""
    return sum(len(step.data) for step in steps if isinstance(step, Write))


def describe(session: Session, profile: Profile, support: int) -> list[str]:
    """Frames, opening, trigger and closing; `support` is how many frames the trigger precedes."""
    initialise = profile.initialise.value
    opening = f"unknown; {profile.initialise.source}"
    if initialise is not None:
        opening = f"{len(initialise)} transfers, of them {uploaded_bytes(initialise)} bytes of bulk data"
    return [
        f"{profile.model}: {len(session.frames)} frames of {session.frame_bytes} bytes from endpoint "
        f"0x{session.endpoint:02x}",
        f"initialisation: {opening}",
        f"trigger: {_show(profile.trigger.value)} ({support} of {len(session.between)} frames)",
        f"closing: {len(profile.finish.value or ())} transfers",
    ]


def describe_registers(writes: Sequence[tuple[int, int]]) -> list[str]:
    """Each register with the values that it was given."""
    values: dict[int, list[int]] = {}
    for number, value in writes:
        values.setdefault(number, []).append(value)
    return [
        f"register {number}: {len(written)} writes, {', '.join(map(str, written[:MAX_LISTED]))}"
        f"{' …' if len(written) > MAX_LISTED else ''}"
        for number, written in sorted(values.items())
    ]


def differences(profile: Profile, base: Profile) -> list[str]:
    """Where the trace contradicts the shipped profile."""
    pairs = (
        ("image endpoint", profile.bulk_in, base.bulk_in),
        ("register endpoint", profile.bulk_out, base.bulk_out),
        ("bytes read per frame", profile.image.read_bytes, base.image.read_bytes),
        ("trigger", profile.trigger, base.trigger),
    )
    return [
        f"{name}: {_show(new.value)} in the trace, {_show(old.value)} ({old.confidence}) as shipped"
        for name, new, old in pairs
        if old.value is not None and new.value != old.value
    ]


def left_out(own: Sequence[Transfer]) -> list[str]:
    """Transfers that are not in the profile."""
    failed = sum(not t.succeeded for t in own if t.kind in ("control", "bulk") and not t.reads)
    other = sum(t.kind not in ("control", "bulk") for t in own)
    found = [f"left out: {failed} transfers to the camera that failed or have no end"] if failed else []
    return [*found, f"left out: {other} interrupt or isochronous transfers"] if other else found


def _show(value: object) -> str:
    return ", ".join(map(str, value)) or "none" if isinstance(value, tuple) else str(value)
