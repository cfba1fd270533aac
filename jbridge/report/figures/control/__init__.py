"""Figures of controllers and of closed loops."""
