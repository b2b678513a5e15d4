"""When the frames of a recording are played: as they were exposed, but for gaps of its clock."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from itertools import accumulate, pairwise
from statistics import median_low

LONGEST_STEP = 60 * 10**9
"""ns from one frame to the next that are waited out; a longer step is a set clock, or a long rest."""

CUT = 10**9
"""ns that a longer step takes instead: it can be seen that something is left out."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Where the recording's clock jumps.

    Attributes:
        frame: the first frame after it, counted from 0.
        seconds: by how much, < 0 = backwards.
    """

    frame: int
    seconds: float

    def __str__(self) -> str:
        if self.seconds < 0:
            return (
                f"at frame {self.frame} the clock goes back by {timedelta(seconds=round(-self.seconds, 3))}"
            )
        return f"at frame {self.frame} the clock goes on by {timedelta(seconds=round(self.seconds))}"


class Timeline:
    """When each frame is due, ns after the first.

    A step back takes as long as frames usually are apart; one of more than a minute takes a second.

    Args:
        timestamps: of the frames in the order in which they are played, ns since the epoch; at least one.
    """

    def __init__(self, timestamps: Sequence[int]) -> None:
        steps = [after - before for before, after in pairwise(timestamps)]
        usual = median_low([step for step in steps if 0 <= step <= LONGEST_STEP] or [CUT])
        self.gaps = tuple(
            Gap(frame, step / 1e9) for frame, step in enumerate(steps, 1) if not 0 <= step <= LONGEST_STEP
        )
        self._due = tuple(accumulate((_taken(step, usual) for step in steps), initial=0))
        self.round = self._due[-1] + max(1, usual)
        """ns from the first frame of a round of a loop to that of the next."""

    def __len__(self) -> int:
        return len(self._due)

    @property
    def duration(self) -> int:
        """ns from the first frame to the last."""
        return self._due[-1]

    def due(self, frame: int) -> int:
        """When a frame is due, ns after the first."""
        return self._due[frame]

    def at(self, due: int) -> int:
        """The frame that is seen at a time, ns after the first: the last that was due by then."""
        return max(0, bisect_right(self._due, due) - 1)


def _taken(step: int, usual: int) -> int:
    if step < 0:
        return usual
    return CUT if step > LONGEST_STEP else step
