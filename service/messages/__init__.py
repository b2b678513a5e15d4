"""What travels: events, bursts, maps; the table of topics; encoding and decoding."""
