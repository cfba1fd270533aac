"""Models that a search compares: candidate effects, one compiled plant for all of them, and fitted structures."""
