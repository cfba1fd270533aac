"""Fuzzy systems as tables of a TOML file, and as MATLAB's `.fis` files."""
