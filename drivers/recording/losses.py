"""How many messages of a recording are lost, as far as the file tells."""

from collections import Counter
from collections.abc import Mapping

from mcap.records import Channel, MessageIndex, Statistics

from drivers.recording.container import Fault, Located
from drivers.recording.records import OpenedChunk

UNKNOWN_TOPIC = "unknown topics"
"""Where messages are counted whose channel was lost."""


class Losses:
    """Counts the messages that are lost: what message indexes and statistics say less what was read.

    Attributes:
        statistics: of the file, where there are any.
    """

    def __init__(self) -> None:
        self.statistics: Statistics | None = None
        self._read: Counter[int] = Counter()
        self._missing: Counter[int] = Counter()
        self._nameless = 0
        self._in_chunk: Counter[int] | None = None

    def message(self, channel: int, *, is_known: bool) -> None:
        """A message was read; one whose channel is not known is of no use."""
        self._read[channel] += 1
        self._nameless += not is_known

    def chunk(self, chunk: OpenedChunk) -> None:
        """A chunk was read; one without a checksum is compared with its message indexes."""
        self._in_chunk = None if chunk.is_checked else Counter(stored.channel for stored in chunk.messages)

    def fault(self, fault: Fault) -> None:
        """A chunk could not be read: its message indexes tell what it held."""
        self._in_chunk = Counter() if fault.part == "chunk" else None

    def index(self, index: MessageIndex, item: Located) -> Fault | None:
        """What a chunk should have held on a channel; a fault where it held more."""
        if self._in_chunk is None:
            return None
        missing = len(index.records) - self._in_chunk[index.channel_id]
        self._missing[index.channel_id] += max(0, missing)
        if missing >= 0:
            return None
        return Fault("index", item.offset, item.length, "a message index does not fit its chunk")

    def by_topic(self, channels: Mapping[int, Channel]) -> Counter[str]:
        """Messages lost of each topic; statistics know better than indexes, where there are any."""
        missing = dict(self._missing)
        if self.statistics is not None:
            said = self.statistics.channel_message_counts
            missing = {channel: count - self._read[channel] for channel, count in said.items()}
        lost = Counter({UNKNOWN_TOPIC: self._nameless}) if self._nameless else Counter[str]()
        for channel, count in missing.items():
            if count > 0:
                known = channels.get(channel)
                lost[UNKNOWN_TOPIC if known is None else known.topic.removeprefix("/")] += count
        return lost
