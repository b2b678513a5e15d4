"""Processes of our own: started, talked to through shared memory, given up in time."""
