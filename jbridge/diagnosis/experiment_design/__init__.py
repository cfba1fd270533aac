"""The next experiment: the input that separates best what the recordings cannot tell apart."""
