"""Where pixels look: positions, rotations, the lens, and points in space."""
