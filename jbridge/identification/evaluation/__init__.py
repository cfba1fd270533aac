"""Errors of a fixed model on recordings: whole recordings, and windows of several lengths."""
