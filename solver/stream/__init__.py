"""A map for every frame, of a window of the last ones."""
