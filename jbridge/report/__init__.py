"""Results for people and for programs: the terminal's summary, `report.json`, `report.html` and its figures.

Everything here reads a `Fit` or a `Diagnosis` and computes nothing new. Programs get SI units; people get
millimetres and degrees where these are the handier ones (`quantities`), and words instead of keys (`words`).
"""
