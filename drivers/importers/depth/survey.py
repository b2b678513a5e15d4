"""What a bag holds: image topics with a sample and their times, optics, transforms."""

from dataclasses import dataclass, field

from drivers.depth.messages import (
    IMAGE_TYPES,
    LENS_TYPES,
    TRANSFORM_TYPES,
    DepthImage,
    LensFound,
    image_of,
    lens_of,
    links_of,
)
from drivers.depth.transforms import TransformTree
from drivers.errors import RecordingError
from drivers.importers.depth.bag import Bag, Packet
from drivers.importers.exposure import Findings, ImportOptions


@dataclass(slots=True)
class ImageTopic:
    """Images of one topic.

    Attributes:
        sample: the first that could be read.
        count: messages.
        times: (stamp, log time) of each, ns, in the order of the file; of the topics that may be of use.
    """

    name: str
    sample: DepthImage
    count: int = 0
    times: list[tuple[int, int]] = field(default_factory=list)

    @property
    def base(self) -> str:
        """The topic that the image is a form of: `x/image_raw` of `x/image_raw/compressedDepth`."""
        base, _, last = self.name.rpartition("/")
        return base if last in ("compressed", "compressedDepth") else self.name


class Survey:
    """One pass over a bag.

    Args:
        bag: the files.
        options: which topics were named.
        findings: what could not be read is noted there.
    """

    def __init__(self, bag: Bag, options: ImportOptions, findings: Findings) -> None:
        self.images: dict[str, ImageTopic] = {}
        self.lenses: dict[str, LensFound] = {}
        self.tree = TransformTree()
        self._named = {_plain(name) for name in (options.topic, options.amplitude) if name}
        self._findings = findings
        for packet in bag.packets(kinds=IMAGE_TYPES | LENS_TYPES | TRANSFORM_TYPES):
            try:
                self._take(packet)
            except RecordingError as error:
                findings.lose(f"{packet.topic}: a message cannot be read: {error}")

    def _take(self, packet: Packet) -> None:
        content = packet.kind, packet.form, packet.payload
        if packet.kind in TRANSFORM_TYPES:
            for link in links_of(*content):
                self.tree.add(link)
        elif packet.kind in LENS_TYPES:
            if packet.topic not in self.lenses:
                self.lenses[packet.topic] = lens_of(*content)
        else:
            self._image(packet)

    def _image(self, packet: Packet) -> None:
        topic = self.images.get(packet.topic)
        if topic is None:
            sample = image_of(packet.kind, packet.form, packet.payload)
            topic = self.images[packet.topic] = ImageTopic(packet.topic, sample)
        topic.count += 1
        if topic.sample.may_be_depth or _plain(packet.topic) in self._named:
            stamp = image_of(packet.kind, packet.form, packet.payload).stamp
            topic.times.append((stamp, packet.log_time))

    def depth(self, named: str | None) -> ImageTopic:
        """The topic of depth images.

        Raises:
            RecordingError: none, or several and none is named.
        """
        if named is not None:
            return self.named(named)
        found = {topic.base: topic for topic in self.images.values() if topic.sample.may_be_depth}
        found |= {topic.base: topic for topic in self.images.values() if topic.base == topic.name in found}
        if len(found) == 1:
            return next(iter(found.values()))
        if found:
            names = ", ".join(sorted(topic.name for topic in found.values()))
            raise RecordingError(f"depth images of several topics: {names}; name one of them (--topic)")
        raise RecordingError(
            f"no topic holds depth images; {self._told()}: name the topic if one of them does (--topic)"
        )

    def named(self, name: str) -> ImageTopic:
        """An image topic by its name, with leading slash or without; raises `RecordingError`."""
        for topic in self.images.values():
            if _plain(topic.name) == _plain(name):
                return topic
        raise RecordingError(f"no image topic is called {name!r}; {self._told()}")

    def lens(self, topic: ImageTopic, named: str | None) -> tuple[str, LensFound] | None:
        """Topic and content of the optics that belong to an image topic; None where it is not said which.

        It lies beside the images (`x/camera_info` of `x/image_raw`, `x/info/camera_info` of `x/image/data`
        in RealSense's files), else is the only one in the axes of the images, else the only one.
        """
        if named is not None:
            return next((item for item in self.lenses.items() if _plain(item[0]) == _plain(named)), None)
        parent = topic.base.rpartition("/")[0]
        above = parent.rpartition("/")[0]
        for name in (f"{parent}/camera_info", f"{above}/info/camera_info", f"{parent}/calibration"):
            if name in self.lenses:
                return name, self.lenses[name]
        frame = topic.sample.frame_id
        same = [item for item in self.lenses.items() if frame and item[1].frame_id == frame]
        for found in (same, list(self.lenses.items())):
            if len(found) == 1:
                return found[0]
        return None

    def _told(self) -> str:
        if not self.images:
            return "there are no images at all"
        return "there are " + ", ".join(
            f"{name} ({topic.sample.told})" for name, topic in sorted(self.images.items())
        )


def _plain(topic: str) -> str:
    """A topic as some write it without the leading slash."""
    return topic.lstrip("/")
