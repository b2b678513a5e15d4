"""The run: states, supervision, status."""
