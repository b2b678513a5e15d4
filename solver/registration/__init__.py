"""Where each frame looks, found from the frames themselves."""

from solver.registration.registering import Registration, register

__all__ = ["Registration", "register"]
