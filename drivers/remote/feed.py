"""From messages to frames: the base of all sources."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.remote.mailbox import Letter


class Feed(ABC):
    """Takes messages and gives frames, once it knows the optics.

    Attributes:
        carries_pose: whether frames bring their own angles, burst and pose.
        model: what the camera is, for people.
        keys: key expression to subscribe to, by role.
        calibration: the latest known.
    """

    carries_pose: ClassVar[bool]
    model: str
    keys: Mapping[str, str]
    calibration: Calibration | None

    @abstractmethod
    def take(self, letter: Letter) -> Frame | None:
        """The frame that a message completes, if it does; raises `RecordingError` for an unusable one."""

    @property
    @abstractmethod
    def missing(self) -> str:
        """What has not come so far, in words."""
