"""Finds the calibration of a camera on its mount from what it sees: boards, walls, still scenes."""
