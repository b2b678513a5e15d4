"""Messages on Zenoh: the session, what is sent and what is received."""
