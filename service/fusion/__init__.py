"""Bursts to maps, in a process of its own."""
