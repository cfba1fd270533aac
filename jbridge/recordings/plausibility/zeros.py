"""The angle's zero in several recordings of one rig: an encoder counts from where it was switched on."""

from collections.abc import Mapping, Sequence

import numpy as np

from jbridge.recordings.checks import GRAVITY
from jbridge.recordings.plausibility.motion import CERTAIN, Cells, rope, swing_cells
from jbridge.recordings.recording import Recording
from jbridge.recordings.tables.columns import Column

BLOCKS, FEWEST = 16, 8
"""Stretches of a swing whose scatter tells how certain its zero is, and moving cells in each of them at least."""
MOVING = 0.2
"""Rate of the angle, over its root mean square, from which on a pivot's friction has a direction."""
SHIFT = 0.05
"""Difference of two zeros over the swing from which on it is told: what is smaller hardly shows in a fit."""


def zero_notes(recordings: Sequence[Recording], columns: Sequence[Mapping[str, Column]]) -> list[str]:
    """Returns for each recording a sentence on its angle's zero, if that is certainly not the others', else nothing.

    Args:
        recordings: of one rig.
        columns: from which the channels of each were read.
    """
    found = [None if recording.psi is None else zero_of(recording) for recording in recordings]
    there = [each for each in found if each is not None]
    notes = [""] * len(recordings)
    if len(there) < 2:
        return notes
    usual, scatter = np.median(there, axis=0)
    for i, own in enumerate(found):
        if own is None:
            continue
        zero, error = own
        psi = recordings[i].samples("psi")[1]
        far = max(CERTAIN * float(np.hypot(error, scatter)), SHIFT * float(np.std(psi)))
        if abs(zero - usual) > far and "psi" in columns[i]:
            line = columns[i]["psi"].zeroed("psi", zero).line("psi")
            notes[i] = (
                f"The load hangs at {zero:.2g} rad in the mean, and at {usual:.2g} rad in most recordings; if the"
                f" sensor was set to zero anew, declare {line} for this recording alone."
            )
    return notes


def zero_of(recording: Recording) -> tuple[float, float] | None:
    """Returns the angle at which a load that swings hangs in the mean, and its standard error [rad]; None where too
    little moves."""
    times, psi = recording.samples("psi")
    samples = {} if recording.l is None else {"l": recording.samples("l")}
    length = rope(recording.times, samples, recording.locked_length)
    if length is None:
        return None
    cart = (times, np.zeros(times.size)) if recording.x is None else recording.samples("x")
    cells = swing_cells(recording.times, (times, psi), cart, length)
    return None if cells is None else hangs_at(cells)


def hangs_at(cells: Cells) -> tuple[float, float] | None:
    """Returns the same from the cells of a swing: what weight and inertia leave, less what goes with the direction and
    with the rate of the swing."""
    angle, rate = cells.middle("psi"), cells.rate("psi")
    turning = cells.middle("l") * cells.acceleration("psi") + 2 * cells.rate("l") * rate
    pull = (turning + cells.acceleration("x") * np.cos(angle)) / GRAVITY + cells.middle("sin")
    size = float(np.sqrt(np.mean(rate[cells.whole] ** 2)))
    moving = cells.whole & (np.abs(rate) > MOVING * size)
    if np.count_nonzero(moving) < BLOCKS * FEWEST:
        return None
    rate, pull = rate[moving], pull[moving]
    terms = np.stack([np.ones(rate.size), np.sign(rate), rate], axis=1)
    known, *_ = np.linalg.lstsq(terms, pull, rcond=None)
    left = pull - terms @ known
    means = [block.mean() for block in np.array_split(left, BLOCKS)]
    return float(known[0]), float(np.std(means, ddof=1) / np.sqrt(BLOCKS))
