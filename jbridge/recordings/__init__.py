"""Recordings of rigs: CSV or .mat files, arrays and data frames, with an optional sidecar, become channels in SI units.

A recording is refused, with one line that says where and what to do, rather than guessed at; what is detected
or assumed about it stands in its notes.
"""

from jbridge.recordings.load import (
    Inspection,
    constant_inputs,
    inspect_recordings,
    load_recording,
    load_recordings,
)
from jbridge.recordings.plausibility.gains import FAR as FAR_GAIN
from jbridge.recordings.plausibility.gains import GUESSED as GUESSED_GAIN
from jbridge.recordings.plausibility.gains import KNOWN as KNOWN_GAIN
from jbridge.recordings.plausibility.gains import check_units, contradiction, drive_gains
from jbridge.recordings.plausibility.gains import remedy as gain_remedy
from jbridge.recordings.recording import Recording, as_recordings, covered_by, required
from jbridge.recordings.tables.csv_table import save_csv

__all__ = [
    "FAR_GAIN",
    "GUESSED_GAIN",
    "Inspection",
    "KNOWN_GAIN",
    "Recording",
    "as_recordings",
    "check_units",
    "constant_inputs",
    "contradiction",
    "covered_by",
    "drive_gains",
    "gain_remedy",
    "inspect_recordings",
    "load_recording",
    "load_recordings",
    "required",
    "save_csv",
]
