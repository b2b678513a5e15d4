"""Frames of a bag."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.depth.messages import DepthImage, image_of
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.importers.depth.bag import Bag
from drivers.importers.depth.framing import MANY, Framing, Image, depth_source
from drivers.importers.depth.poses import Directions, directions
from drivers.importers.depth.schedule import Slot, image_key, schedule
from drivers.importers.depth.survey import ImageTopic, Survey
from drivers.importers.exposure import Findings, ImportOptions
from drivers.importers.found import Import

_MOST_WAITING = 64
"""Images that wait for one that comes later in the file; one of 640 × 480 pixels has about a megabyte."""

_Key = tuple[str, int]


def import_bag(
    paths: Sequence[Path], options: ImportOptions, frames_per_burst: int | None, findings: Findings
) -> Import:
    """Depth images of a bag, with amplitude, optics and directions as far as it has them.

    Raises:
        RecordingError: the bag cannot be read, it is not said which images are meant or what they hold, or
            no optics belong to them.
        NotAvailableError: a library that reads it is not installed.
    """
    bag = Bag(paths, findings)
    survey = Survey(bag, options, findings)
    depth = survey.depth(options.topic)
    amplitude = None if options.amplitude is None else survey.named(options.amplitude)
    calibration = options.calibration or _calibration(survey, depth, options, findings)
    framing = Framing(calibration, options, frames_per_burst)
    if depth.sample.told.startswith(("16", "mono16")) and options.reading.scale is None:
        findings.note(f"{depth.name}: {depth.sample.told} is taken to be millimetres (REP 118)")
    slots = schedule(depth, amplitude, findings)
    if not slots:
        raise RecordingError(f"{depth.name}: no frame can be made of its {depth.count} images")
    if frames_per_burst is None and len(slots) > MANY:
        findings.note(f"all {len(slots)} frames are one burst, more than can be fused at once: give --burst")
    looked = directions(survey.tree, depth.sample.frame_id, [slot.stamp for slot in slots], findings)
    if options.calibration is None:
        calibration = calibration.model_copy(update={"mount": looked.mount})
    topics = (depth, amplitude)
    return Import(
        source=depth_source(f"depth camera on {depth.name}", calibration, options),
        calibration=calibration,
        optics_residual=None,
        count=len(slots),
        findings=findings,
        _frames=lambda: _Stream(bag, topics, slots, looked, framing, findings).frames(),
    )


def _calibration(
    survey: Survey, depth: ImageTopic, options: ImportOptions, findings: Findings
) -> Calibration:
    found = survey.lens(depth, options.camera_info)
    if found is None:
        there = ", ".join(sorted(survey.lenses)) or "none at all"
        raise RecordingError(
            f"{depth.name}: no camera information belongs to it (there is {there}); name its topic "
            "(--camera-info) or a calibration file (--calibration)"
        )
    name, told = found
    rectified = options.rectified
    if rectified is None:
        rectified = "rect" in depth.base.rpartition("/")[2]
        if rectified:
            findings.note(
                f"{depth.name} is taken to be rectified, after its name: no distortion is left in it"
            )
    return (told.rectified if rectified else told.raw).calibration(name)


class _Stream:
    """A second pass over the bag, frame after frame in the order of the slots."""

    def __init__(
        self,
        bag: Bag,
        topics: tuple[ImageTopic, ImageTopic | None],
        slots: Sequence[Slot],
        looked: Directions,
        framing: Framing,
        findings: Findings,
    ) -> None:
        self._bag, self._depth = bag, topics[0].name
        self._amplitude = None if topics[1] is None else topics[1].name
        self._slots, self._looked, self._framing, self._findings = slots, looked, framing, findings
        self._wanted = {key for slot in slots for key in self._keys(slot)}
        self._waiting: dict[_Key, NDArray[Any] | None] = {}
        self._left = 0

    def frames(self) -> Iterator[Frame]:
        """Frames; what cannot be read is noted as lost."""
        following = 0
        names = {self._depth} if self._amplitude is None else {self._depth, self._amplitude}
        for packet in self._bag.packets(names):
            try:
                image = image_of(packet.kind, packet.form, packet.payload)
            except RecordingError:  # told by the first pass
                continue
            self._take(packet.topic, image_key(image.stamp, packet.log_time), image)
            while following < len(self._slots) and (
                self._is_there(following) or len(self._waiting) > _MOST_WAITING
            ):
                yield from self._frame(following)
                following += 1
        for number in range(following, len(self._slots)):
            yield from self._frame(number)
        if self._left:
            self._findings.lose(f"{self._left} of {len(self._slots)} frames were left out for that")

    def _take(self, topic: str, key: int, image: DepthImage) -> None:
        if (topic, key) not in self._wanted:
            return
        self._wanted.discard((topic, key))
        try:
            pixels = image.depth() if topic == self._depth else image.decode()
        except RecordingError as error:
            self._findings.lose(f"{topic}: {error}")
            pixels = None
        self._waiting[topic, key] = pixels

    def _is_there(self, number: int) -> bool:
        return all(key in self._waiting for key in self._keys(self._slots[number]))

    def _frame(self, number: int) -> Iterator[Frame]:
        slot = self._slots[number]
        images = [self._waiting.pop(key, None) for key in self._keys(slot)]
        if any(image is None for image in images):
            self._left += 1
            return
        depth, amplitude = images[0], images[1] if len(images) > 1 else None
        assert depth is not None
        try:
            yield self._framing.frame(Image(depth, amplitude), slot.timestamp, self._looked.angles[number])
        except RecordingError as error:
            self._findings.lose(f"{self._depth}: {error}")
            self._left += 1

    def _keys(self, slot: Slot) -> list[_Key]:
        keys = [(self._depth, slot.depth)]
        if self._amplitude is not None and slot.amplitude is not None:
            keys.append((self._amplitude, slot.amplitude))
        return keys
