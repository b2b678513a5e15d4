"""Cameras whose images others publish over Zenoh."""

from drivers.remote.camera import ZenohCamera

__all__ = ["ZenohCamera"]
