"""Plans of poses, and what they will give."""
