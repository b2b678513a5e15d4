"""Depth images of other cameras, from bags of messages and folders of pictures."""
