"""From a trace of the vendor's software to a profile that the camera `usb` can follow.

Nothing is invented: what the owner's own software sent to the owner's own camera is written down, and marked
`learned`.
"""

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from drivers.errors import RecordingError
from drivers.usb.findings import describe, describe_registers, differences, left_out, uploaded_bytes
from drivers.usb.profile import Fact, Profile, shipped_profiles
from drivers.usb.sessions import (
    SET_CONFIGURATION,
    Session,
    cut_session,
    ids_in,
    serial_in,
    steps_of,
    without_pause,
)
from drivers.usb.steps import RegisterWrite, Step
from drivers.usb.trace import Transfer, read_transfers

RegisterName = Literal["integration_time", "amplitude_threshold"]


@dataclass(frozen=True)
class Lesson:
    """A profile and, in words, what the trace showed."""

    profile: Profile
    findings: tuple[str, ...]


def learn(
    path: Path,
    model: str | None = None,
    registers: Mapping[RegisterName, Sequence[int]] | None = None,
    serial: str | None = None,
) -> Lesson:
    """Read a usbmon or USBPcap capture and write down what a camera needs.

    Args:
        path: pcapng or pcap file.
        model: needed where the capture does not hold the camera's descriptor.
        registers: for a setting, the values that were set one after the other while the trace was taken.
        serial: of the camera, needed where the capture does not hold it; the profile is for no other one.

    Raises:
        RecordingError: not such a capture, no SwissRanger in it, too few frames, or a register that the trace
            does not tell; says what to do.
    """
    transfers = read_transfers(path)
    device, base = _camera(transfers, model, path)
    own = [transfer for transfer in transfers if transfer.device == device]
    session = cut_session(own, base)
    source = f"trace {path.name}, SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"
    base = base.model_copy(update={"serial": serial or serial_in(transfers, device)})
    return _lesson(session, own, base, source, dict(registers or {}))


def _camera(transfers: list[Transfer], model: str | None, path: Path) -> tuple[tuple[int, int], Profile]:
    profiles = [profile for profile in shipped_profiles() if model in (None, profile.model)]
    if not profiles:
        names = ", ".join(profile.model for profile in shipped_profiles())
        raise RecordingError(f"no model is called {model!r}; there are: {names}")
    images: Counter[tuple[int, int]] = Counter()
    for transfer in transfers:
        if transfer.kind == "bulk" and transfer.reads:
            images[transfer.device] += transfer.length
    seen = ids_in(transfers)
    for device, _ in images.most_common():
        fitting = [
            profile
            for profile in profiles
            if any((known.vendor, known.product) == seen.get(device) for known in profile.ids)
        ]
        if len(fitting) > 1:
            names = " or ".join(profile.model for profile in fitting)
            raise RecordingError(f"{path}: the camera's id is that of {names}: say which with --model")
        if fitting:
            return device, fitting[0]
    if model is None:
        raise RecordingError(
            f"{path}: no SwissRanger is named in the trace. If it was plugged in before the capture began, "
            "say its model with --model; else capture the bus that it is on"
        )
    if not images:
        raise RecordingError(f"{path}: no device sends anything by bulk transfers; capture the camera's bus")
    return images.most_common(1)[0][0], profiles[0]


def _lesson(
    session: Session,
    own: list[Transfer],
    base: Profile,
    source: str,
    registers: dict[RegisterName, Sequence[int]],
) -> Lesson:
    def fact(value: Any) -> Fact[Any]:
        return Fact[Any](value=value, confidence="learned", source=source)

    bulk_out = _bulk_out(own, base)
    trigger, support = _trigger(session, bulk_out)
    before = steps_of(session.before, bulk_out)
    is_triggered = bool(trigger) and [without_pause(step) for step in before[-len(trigger) :]] == trigger
    initialise = before[: -len(trigger)] if is_triggered else before
    finish = [s for s in steps_of(session.after, bulk_out) if not isinstance(s, RegisterWrite)]
    writes = [
        (step.number, step.value)
        for step in steps_of(session.transfers, bulk_out)
        if isinstance(step, RegisterWrite)
    ]
    changes: dict[str, Any] = {
        "note": f"Learned from {source}. It may hold the vendor's firmware: keep it to yourself.",
        "bulk_in": fact(session.endpoint),
        "bulk_out": fact(bulk_out),
        "initialise": fact(tuple(initialise)),
        "trigger": fact(tuple(trigger)),
        "finish": fact(tuple(finish)),
        "image": _image(session, base, fact),
        "registers": _registers(writes, registers, base, fact),
    }
    if base.initialise.value is None and not uploaded_bytes(initialise):
        changes["initialise"] = Fact[Any](
            confidence="unknown",
            source="the trace shows no upload, so it began after the camera was opened: begin it before.",
        )
    configured = [t.setup[2] for t in own if t.setup[:2] == SET_CONFIGURATION]
    if configured:
        changes["configuration"] = fact(configured[-1])
    changes["exposure"] = _exposure(changes["registers"].integration_time, writes, base)
    profile = Profile.model_validate(base.model_copy(update=changes).model_dump(mode="json"))
    return Lesson(
        profile,
        (
            *describe(session, profile, support),
            *differences(profile, base),
            *describe_registers(writes),
            *left_out(own),
        ),
    )


def _bulk_out(own: list[Transfer], base: Profile) -> int:
    pairs = Counter(t.endpoint for t in own if t.kind == "bulk" and not t.reads and t.length == 2)
    return pairs.most_common(1)[0][0] if pairs else base.bulk_out.known


def _trigger(session: Session, bulk_out: int) -> tuple[list[Step], int]:
    """What precedes most frames, register writes aside, and how many frames it precedes."""
    gaps = Counter(
        tuple(without_pause(s) for s in steps_of(gap, bulk_out) if not isinstance(s, RegisterWrite))
        for gap in session.between
    )
    trigger, support = gaps.most_common(1)[0]
    if support * 2 <= len(session.between):
        raise RecordingError(
            f"no transfer precedes most frames alike (the commonest {support} of {len(session.between)}); "
            "record a session that only opens, takes ten frames and closes"
        )
    return list(trigger), support


def _registers(
    writes: list[tuple[int, int]],
    told: dict[RegisterName, Sequence[int]],
    base: Profile,
    fact: Any,
) -> Any:
    changes: dict[str, Any] = {}
    if values := told.get("integration_time"):
        changes["integration_time"] = fact(_register_of(writes, list(values)))
    if values := told.get("amplitude_threshold"):
        high, low = ([value >> 8 for value in values], [value & 0xFF for value in values])
        changes["amplitude_threshold"] = fact((_register_of(writes, high), _register_of(writes, low)))
    return base.registers.model_copy(update=changes)


def _register_of(writes: list[tuple[int, int]], values: list[int]) -> int:
    """The one register that got these values, one right after the other."""
    found = []
    for number in sorted({number for number, _ in writes}):
        got = [value for other, value in writes if other == number]
        if any(got[i : i + len(values)] == values for i in range(len(got) - len(values) + 1)):
            found.append(number)
    if len(found) != 1:
        which = f"registers {', '.join(map(str, found))}" if found else "no register"
        raise RecordingError(
            f"{which} got the values {values} one after the other; set several values that nothing else "
            "uses, and name them in the order in which they were set"
        )
    return found[0]


def _image(session: Session, base: Profile, fact: Any) -> Any:
    size = session.frame_bytes
    changes: dict[str, Any] = {"read_bytes": fact(size)}
    if not base.image.frame_bytes <= size < base.image.frame_bytes + base.image.plane_bytes:
        changes["planes"] = Fact[Any](
            confidence="unknown",
            source=f"frames in the trace have {size} bytes, {size / base.image.plane_bytes:g} images; which "
            "they are is not in a trace: look at them, and write their names here",
        )
    return base.image.model_copy(update=changes)


def _exposure(register: Fact[int], writes: list[tuple[int, int]], base: Profile) -> Any:
    """The model's formula; it starts at what the trace last set, where the register is known."""
    values = [value for number, value in writes if number == register.value]
    if base.exposure.value is None or not values:
        return base.exposure
    exposure = base.exposure.value
    initial = exposure.offset + exposure.step * values[-1]
    if not initial:
        return base.exposure
    return base.exposure.model_copy(
        update={"value": exposure.model_copy(update={"initial": round(initial, 6)})}
    )
