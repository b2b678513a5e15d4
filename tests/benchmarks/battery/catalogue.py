"""Scenes by name, and the door that whatever tunes has to go through."""

from reported import REPORTED
from tuning import TUNING

from drivers.simulation.scene import Scene

SCENES = {**TUNING, **REPORTED}


def to_report(name: str) -> Scene:
    """Any scene, to measure on."""
    return SCENES[name]()


def to_tune(name: str) -> Scene:
    """A scene that may be tuned with.

    Raises:
        ValueError: it is only to be reported on.
    """
    if name in REPORTED:
        raise ValueError(
            f"scene {name!r} is only reported on: what was tuned with it says nothing about scenes that "
            f"were not; tune with {', '.join(TUNING)}"
        )
    return TUNING[name]()
