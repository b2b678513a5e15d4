"""Which software this is."""

from importlib.metadata import PackageNotFoundError, version


def software_version() -> str:
    """Version of the installed distribution; `unknown` where the source tree is used as it is."""
    try:
        return version("lidarboost")
    except PackageNotFoundError:
        return "unknown"
