"""Recordings as arrays: the grid, the noise, windows and their initial states."""
