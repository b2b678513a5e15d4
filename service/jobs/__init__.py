"""One-shot work: fuse, import, export, simulate, a quick look."""
