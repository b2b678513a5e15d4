"""Where each frame looks, found from the frames themselves."""

from solver.registration.reference import check_first
from solver.registration.registering import Registration, register
from solver.registration.tracking import Track

__all__ = ["Registration", "Track", "check_first", "register"]
