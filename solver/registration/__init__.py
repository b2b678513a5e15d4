"""Where each frame looks, found from the frames themselves."""

from solver.registration.registering import Registration, register
from solver.registration.tracking import Track

__all__ = ["Registration", "Track", "register"]
