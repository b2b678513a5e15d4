"""What a trace showed, in words for its owner."""

from collections import Counter
from collections.abc import Iterable, Sequence

from drivers.usb.profile import Profile
from drivers.usb.sessions import Session
from drivers.usb.steps import TYPE_MASK, VENDOR_TYPE, Control, Read, RegisterWrite, Step, Write, writes_flash
from drivers.usb.trace import Transfer

MAX_LISTED = 12
"""Values of a register that are listed."""


def uploaded_bytes(steps: Iterable[Step]) -> int:
    """Bytes of bulk data that a sequence sends, register writes aside."""
    return sum(len(step.data) for step in steps if isinstance(step, Write))


def describe(session: Session, profile: Profile, support: int) -> list[str]:
    """Frames, what will be sent, and to which camera; `support` is how many frames the trigger precedes."""
    owner = f"the camera with the serial number {profile.serial}, and no other"
    if profile.serial is None:
        owner = (
            "any camera of this model, for the trace does not tell its serial number: say it with --serial"
        )
    return [
        f"{profile.model}: {len(session.frames)} frames of {session.frame_bytes} bytes from endpoint "
        f"0x{session.endpoint:02x}",
        *describe_sending(profile),
        f"trigger: precedes {support} of {len(session.between)} frames",
        f"used for: {owner}",
    ]


def describe_sending(profile: Profile) -> list[str]:
    """All that a profile sends, in words, a line for each occasion."""
    occasions = (
        ("on opening", profile.initialise),
        ("for each frame", profile.trigger),
        ("on closing", profile.finish),
    )
    return [
        f"{when} it sends: {_sum_up(fact.value) if fact.value is not None else f'unknown; {fact.source}'}"
        for when, fact in occasions
    ]


def _sum_up(steps: Sequence[Step]) -> str:
    """Steps in the order of their first appearance, equal ones counted together."""
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    for step in steps:
        if isinstance(step, Control):
            kind = f"request 0x{step.request:02x} (type 0x{step.request_type:02x})"
        elif isinstance(step, RegisterWrite):
            kind = f"register {step.number} = {step.value}"
        else:
            kind = f"bulk {'read from' if isinstance(step, Read) else 'write to'} 0x{step.endpoint:02x}"
        counts[kind] += 1
        sizes[kind] += len(step.data) if isinstance(step, Control | Write) else 0
    return (
        ", ".join(
            kind + (f" × {number}" if number > 1 else "") + (f", {sizes[kind]} bytes" if sizes[kind] else "")
            for kind, number in counts.items()
        )
        or "nothing"
    )


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
    """Transfers that are not in the profile, and those in it that its owner should look at."""
    sent = [t for t in own if t.kind in ("control", "bulk") and not t.reads]
    flash = sum(
        t.kind == "control" and writes_flash(t.setup[0], t.setup[1]) for t in sent if t.setup or t.data
    )
    failed = sum(not t.succeeded for t in sent)
    other = sum(t.kind not in ("control", "bulk") for t in own)
    with_data = (
        sum(bool(t.setup) and t.setup[0] & TYPE_MASK == VENDOR_TYPE and t.length > 0 for t in sent) - flash
    )
    lines = (
        (flash, "left out: {} requests that write the EEPROM of the camera's USB chip"),
        (failed, "left out: {} transfers to the camera that failed or have no end"),
        (other, "left out: {} interrupt or isochronous transfers"),
        (
            with_data,
            "mind: {} requests carry data to the camera. The vendor's library writes flash by such requests "
            "too: make sure that nothing was updated while the trace was taken",
        ),
    )
    return [text.format(number) for number, text in lines if number]


def _show(value: object) -> str:
    return ", ".join(map(str, value)) or "none" if isinstance(value, tuple) else str(value)
