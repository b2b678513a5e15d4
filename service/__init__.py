"""The acquisition daemon and its command line."""
