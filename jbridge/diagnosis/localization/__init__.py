"""Where a mismatch is: the missing force along recordings, the regions that hold it, its symmetries, its equation."""
