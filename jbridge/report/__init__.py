"""Results for people and for programs: the terminal's summary, `report.json`, `report.html` and its figures.

What fits, diagnoses, controllers and sweeps found is shown and written here, and nothing new is estimated. Programs get
SI units; people get millimetres and degrees where these are the handier ones (`quantities`), and words instead of keys
(`words`).
"""
