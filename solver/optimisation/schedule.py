"""The steps of a descent that sharpens its penalties as it goes (graduated non-convexity)."""

from dataclasses import dataclass

_SHARP = 12.0
"""Bluntness under which the prior gives way where the samples contradict it; before, noise is followed."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step: factor on δ, rounds of conjugate gradients, and whether the prior is eased anew before."""

    blunt: float
    rounds: int
    eases: bool = False


def schedule(falling: int, staying: int) -> tuple[Step, ...]:
    """From 200 times δ, 0.4 m, down to twice δ in so many falling steps, so many there, and one at δ."""
    blunts = [*(2 * 100 ** (1 - number / falling) for number in range(falling)), *[2.0] * staying, 1.0]
    return tuple(Step(blunt, 11 if blunt > 2 else 12, blunt < _SHARP) for blunt in blunts)


SCHEDULE = schedule(7, 3)
"""Steps count for more than rounds: in each of them the tilt carries what one window knows to the next, which
dim surfaces need. Without the sharper last step surfaces keep noise that δ takes for relief; with two of them
steps of a few centimetres are sharper and curved walls are bent."""
