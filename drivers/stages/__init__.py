"""Rotation stages on a serial line."""
