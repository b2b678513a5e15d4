"""Depth superresolution from slightly rotated time-of-flight frames: arrays in, arrays out."""
