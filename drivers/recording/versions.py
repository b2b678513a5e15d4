"""Versions of the software that makes a recording."""

import platform
from importlib.metadata import PackageNotFoundError, version

_DISTRIBUTIONS = ("lidarboost", "numpy", "scipy", "numba", "mcap", "foxglove-schemas-protobuf")


def versions() -> dict[str, str]:
    """By name: Python, the platform, this program and what it is built on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # run from a source tree, or built without a part
            found[name] = "unknown"
    return found


def library() -> str:
    """What an MCAP file names as its writer."""
    return f"lidarboost {versions()['lidarboost']}"
