"""Depth images of other cameras: pixels, what they stand for, and the optics behind them."""
