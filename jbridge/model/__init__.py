"""The plant: a rigid bridge and the effects that act on it."""
