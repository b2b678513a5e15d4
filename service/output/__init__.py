"""Files: recordings, pictures, exports."""
