"""Estimation of a model's unknown numbers from recordings."""
