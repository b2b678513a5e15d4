"""Devices, plans and the bursts of frames they give."""
