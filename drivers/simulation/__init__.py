"""A physical simulation of a time-of-flight camera: surfaces, rays, phasors, noise."""

from drivers.simulation.scenes import SCENES, build_scene

__all__ = ["SCENES", "build_scene"]
