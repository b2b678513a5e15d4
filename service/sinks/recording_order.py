"""What a recorder shall do, as it was asked; changed by others while it works."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Wish:
    """That something is recorded.

    Attributes:
        maps: fused maps too, beside frames and all else.
        replays: also while a recording is played.
    """

    maps: bool = True
    replays: bool = False


class RecordingOrder:
    """The wish in force; None = nothing is recorded, only what a recording would begin with is kept.

    It outlives the recorder: one that is started again goes on with it.
    """

    def __init__(self, wish: Wish | None) -> None:
        self.wish = wish
