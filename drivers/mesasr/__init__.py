"""SwissRanger cameras through the vendor's library, where it is installed."""

from drivers.mesasr.camera import MesaCamera

__all__ = ["MesaCamera"]
