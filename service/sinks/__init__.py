"""Who takes events: publisher, recorder, pictures."""
