"""The configuration: sections, and how they are read."""
