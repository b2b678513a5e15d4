"""Frames from the files of other programs."""

from drivers.importers.exposure import Findings, ImportOptions
from drivers.importers.found import Import
from drivers.importers.importing import import_frames

__all__ = ["Findings", "Import", "ImportOptions", "import_frames"]
