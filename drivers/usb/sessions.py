"""A recorded session of the vendor's software, cut into opening, frames and closing."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.errors import RecordingError
from drivers.usb.profile import Profile
from drivers.usb.steps import TYPE_MASK, Control, Read, RegisterWrite, Step, Write, writes_flash
from drivers.usb.trace import Transfer

DEVICE_DESCRIPTOR = bytes((0x80, 6, 0, 1))
"""Start of the standard request that reads a device's ids (USB 2.0, section 9.4.3)."""

STRING_DESCRIPTOR = bytes((0x80, 6))
"""Start of the standard request that reads a string; its number and kind 3 follow."""

SET_CONFIGURATION = bytes((0x00, 9))

PAUSE_FLOOR = 0.005
"""Seconds; shorter gaps are the host's own pace."""

PAUSE_CEILING = 2.0
"""Seconds; longer gaps are people's pace."""

POLLED_BYTES = 8
"""Longest answer that counts as a state that is polled; longer ones hold measurements that never repeat."""

MIN_FRAMES = 3
"""Frames that a trace must show before anything is called a trigger."""


@dataclass
class Session:
    """What one camera did in a trace.

    Attributes:
        before: transfers before the first frame.
        frames: transfers of each frame's image.
        between: transfers since the frame before, for each frame but the first.
        after: transfers after the last frame.
    """

    before: list[Transfer] = field(default_factory=list)
    frames: list[list[Transfer]] = field(default_factory=list)
    between: list[list[Transfer]] = field(default_factory=list)
    after: list[Transfer] = field(default_factory=list)

    @property
    def frame_bytes(self) -> int:
        """The usual size of a frame."""
        sizes = Counter(sum(part.length for part in frame) for frame in self.frames)
        return sizes.most_common(1)[0][0]

    @property
    def endpoint(self) -> int:
        return self.frames[0][0].endpoint

    @property
    def transfers(self) -> list[Transfer]:
        """Everything but the images, in order."""
        return [*self.before, *(transfer for gap in self.between for transfer in gap), *self.after]


def ids_in(transfers: Sequence[Transfer]) -> dict[tuple[int, int], tuple[int, int]]:
    """Vendor and product id of each device whose descriptor the trace holds."""
    return {
        transfer.device: (
            int.from_bytes(transfer.data[8:10], "little"),
            int.from_bytes(transfer.data[10:12], "little"),
        )
        for transfer in transfers
        if transfer.setup[:4] == DEVICE_DESCRIPTOR and len(transfer.data) >= 12
    }


def serial_in(transfers: Sequence[Transfer], device: tuple[int, int]) -> str | None:
    """The serial number in the descriptors of a device (USB 2.0, sections 9.6.1 and 9.6.7), or None."""
    own = [transfer for transfer in transfers if transfer.device == device]
    index = next((t.data[16] for t in own if t.setup[:4] == DEVICE_DESCRIPTOR and len(t.data) >= 17), 0)
    answers = [t.data for t in own if index and t.setup[:4] == STRING_DESCRIPTOR + bytes((index, 3))]
    texts = [data[2 : data[0]].decode("utf-16-le", "replace").strip() for data in answers if len(data) > 2]
    return max(texts, key=len, default="") or None


def cut_session(transfers: Sequence[Transfer], base: Profile) -> Session:
    """Cut one device's transfers.

    Frames are runs of bulk reads, on the endpoint that brings the most bytes, at least half as long as one
    image; a run ends with any other transfer, or, where hardly any come between, with the model's frame.

    Raises:
        RecordingError: fewer frames than are needed to tell a trigger.
    """
    reads: Counter[int] = Counter()
    for transfer in transfers:
        if transfer.kind == "bulk" and transfer.reads:
            reads[transfer.endpoint] += transfer.length
    endpoint = reads.most_common(1)[0][0] if reads else None
    usual = base.image.read_bytes.value or base.image.frame_bytes
    session, gap = Session(), list[Transfer]()
    for run in _runs(transfers, endpoint, usual):
        size = sum(part.length for part in run)
        if run[0].endpoint == endpoint and run[0].kind == "bulk" and size >= base.image.plane_bytes // 2:
            (session.between.append(gap) if session.frames else session.before.extend(gap))
            session.frames.append(run)
            gap = []
        else:
            gap.extend(run)
    session.after = gap
    if len(session.frames) < MIN_FRAMES:
        raise RecordingError(
            f"the trace shows {len(session.frames)} frames of the {base.model}; record one in which the "
            "vendor's software opens the camera, takes ten frames and closes it"
        )
    return session


def _runs(transfers: Sequence[Transfer], endpoint: int | None, usual: int) -> list[list[Transfer]]:
    """Each image with all its pieces; every other transfer by itself."""
    runs = _uninterrupted(transfers, endpoint, None)
    images = [run for run in runs if run[0].kind == "bulk" and run[0].endpoint == endpoint]
    if len(images) < MIN_FRAMES:  # a camera that sends by itself: nothing comes between its frames
        return _uninterrupted(transfers, endpoint, usual)
    return runs


def _uninterrupted(
    transfers: Sequence[Transfer], endpoint: int | None, most: int | None
) -> list[list[Transfer]]:
    runs: list[list[Transfer]] = []
    size = 0  # bytes of an image that may go on
    for transfer in transfers:
        is_image = transfer.kind == "bulk" and transfer.endpoint == endpoint
        if is_image and not transfer.length:
            continue  # a read that brought nothing is the host's business
        if is_image and size and (most is None or size < most):
            runs[-1].append(transfer)
            size += transfer.length
        else:
            runs.append([transfer])
            size = transfer.length if is_image else 0
    return runs


def steps_of(transfers: Sequence[Transfer], bulk_out: int) -> list[Step]:
    """The transfers as steps that can be sent again; standard, failed and flash-writing ones are left out.

    Raises:
        RecordingError: bytes that were sent are missing in the capture.
    """
    steps: list[tuple[Step, Transfer]] = []
    previous: Transfer | None = None
    for transfer in transfers:
        step = _step(transfer, bulk_out, _pause(previous, transfer))
        if step is not None:
            steps.append((step, transfer))
            previous = transfer
    return _collapse_polls(steps)


def without_pause(step: Step) -> Step:
    """The same step, to be compared with others."""
    return step.model_copy(update={"pause": 0.0})


def _step(transfer: Transfer, bulk_out: int, pause: float) -> Step | None:
    is_standard = transfer.kind == "control" and (not transfer.setup or not transfer.setup[0] & TYPE_MASK)
    if is_standard or transfer.kind not in ("control", "bulk") or not transfer.succeeded:
        return None
    if transfer.kind == "control" and writes_flash(transfer.setup[0], transfer.setup[1]):
        return None
    if not transfer.reads and transfer.is_truncated:
        raise RecordingError(
            f"the capture holds {len(transfer.data)} of {transfer.length} bytes of a transfer to the camera; "
            "capture again with an unlimited snapshot length (tcpdump -s0, Wireshark's default)"
        )
    if transfer.kind == "control":
        return _control(transfer, pause)
    if transfer.reads:
        return Read(endpoint=transfer.endpoint, length=transfer.asked or transfer.length or 512, pause=pause)
    if transfer.endpoint == bulk_out and len(transfer.data) == 2:
        return RegisterWrite(number=transfer.data[0], value=transfer.data[1], pause=pause)
    return Write(endpoint=transfer.endpoint, data=transfer.data, pause=pause)


def _control(transfer: Transfer, pause: float) -> Control:
    setup = transfer.setup
    return Control(
        request_type=setup[0],
        request=setup[1],
        value=int.from_bytes(setup[2:4], "little"),
        index=int.from_bytes(setup[4:6], "little"),
        data=b"" if transfer.reads else transfer.data,
        length=int.from_bytes(setup[6:8], "little") if transfer.reads else 0,
        pause=pause,
    )


def _pause(previous: Transfer | None, transfer: Transfer) -> float:
    if previous is None or previous.completed is None:
        return 0.0
    gap = (transfer.submitted - previous.completed) / 1e9
    return round(min(gap, PAUSE_CEILING), 3) if gap >= PAUSE_FLOOR else 0.0


def _collapse_polls(steps: list[tuple[Step, Transfer]]) -> list[Step]:
    """Runs of one read whose answer changed become one step that waits for the last answer."""
    collapsed: list[Step] = []
    start = 0
    while start < len(steps):
        step, first = steps[start]
        end = start + 1
        while end < len(steps) and without_pause(steps[end][0]) == without_pause(step):
            end += 1
        last = steps[end - 1][1]
        is_poll = isinstance(step, Control) and step.reads and 0 < len(last.data) <= POLLED_BYTES
        if is_poll and last.data != first.data:
            collapsed.append(step.model_copy(update={"until": last.data}))
        else:
            collapsed.extend(step for step, _ in steps[start:end])
        start = end
    return collapsed
