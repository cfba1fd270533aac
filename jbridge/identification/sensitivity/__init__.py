"""Predictions of windows and their derivatives by parameters and initial states."""
