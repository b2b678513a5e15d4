"""Cameras and rotation stages, the frames they produce, and recordings of them."""
