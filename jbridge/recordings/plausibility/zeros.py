"""The angle's zero in several recordings of one rig: an encoder counts from where it was switched on."""

from collections.abc import Mapping, Sequence

import numpy as np

from jbridge.recordings.checks import GRAVITY
from jbridge.recordings.plausibility.sensors import HANGS
from jbridge.recordings.plausibility.swing_equation import Cells, rope, swing_cells
from jbridge.recordings.recording import Recording
from jbridge.recordings.tables.columns import Column

BLOCKS, FEWEST = 16, 8
"""Stretches of a swing whose scatter tells how certain its zero is, and moving cells in each of them at least."""
MOVING = 0.2
"""Rate of the angle, over its root mean square, from which on a pivot's friction has a direction."""
ERRORS = 5.0
"""Standard errors by which the farthest two of many zeros differ for certain."""
SHIFT = 0.05
"""Difference of two zeros over the swing from which on it is told: what is smaller hardly shows in a fit."""


def zero_notes(recordings: Sequence[Recording], columns: Sequence[Mapping[str, Column]]) -> dict[int, str]:
    """Returns sentences on the angles whose zero is not where the load hangs, by number of the recording, if that is
    certainly not the same in all recordings; where it is, a diagnosis finds it.

    Args:
        recordings: of one rig.
        columns: from which the channels of each were read; what has no `psi` is left out.
    """
    angles = {i: hanging_angle(each) for i, each in enumerate(recordings) if "psi" in columns[i]}
    zeros = {i: zero for i, zero in angles.items() if zero is not None}
    notes = {}
    for i, (angle, error) in zeros.items():
        other, (farthest, others) = max(zeros.items(), key=lambda each: abs(each[1][0] - angle))
        least = SHIFT * float(np.std(recordings[i].samples("psi")[1]))
        apart = abs(angle - farthest) > max(ERRORS * float(np.hypot(error, others)), least)
        if apart and abs(angle) > max(ERRORS * error, least):
            name = recordings[i].name
            line = columns[i]["psi"].zeroed("psi", angle).line("psi")
            notes[i] = (
                f"{HANGS}{angle:.2g} rad in the mean, and at {farthest:.2g} rad in {recordings[other].name}; if the"
                f' sensor was set to zero anew, declare {line} for {name} alone, under ["{name}".columns] in'
                " recordings.toml or in a sidecar of its own."
            )
    return notes


def hanging_angle(recording: Recording) -> tuple[float, float] | None:
    """Returns the angle at which a load that swings hangs in the mean, and its standard error [rad]; None where too
    little moves, or where nothing hangs."""
    times, psi = recording.samples("psi")
    samples = {} if recording.l is None else {"l": recording.samples("l")}
    length = rope(recording.times, samples, recording.locked_length)
    if length is None or np.mean(np.cos(psi)) <= 0:
        return None
    cart = (times, np.zeros(times.size)) if recording.x is None else recording.samples("x")
    cells = swing_cells(recording.times, (times, psi), cart, length)
    return None if cells is None else fitted_zero(cells)


def fitted_zero(cells: Cells) -> tuple[float, float] | None:
    """Returns the zero of a swing's angle and its standard error [rad], None where too little moves.

    The load's equation of motion leaves gravity times the zero, times the cosine of the angle; and what goes with the
    direction and with the rate of the swing is friction.
    """
    angle, rate = cells.middle("psi"), cells.rate("psi")
    turning = cells.middle("l") * cells.acceleration("psi") + 2 * cells.rate("l") * rate
    left = (turning + cells.acceleration("x") * np.cos(angle)) / GRAVITY + cells.middle("sin")
    moving = cells.whole & (np.abs(rate) > MOVING * float(np.sqrt(np.mean(rate[cells.whole] ** 2))))
    if np.count_nonzero(moving) < BLOCKS * FEWEST:
        return None
    angle, rate, left = angle[moving], rate[moving], left[moving]
    terms = np.stack([np.cos(angle), np.sign(rate), rate], axis=1)
    fitted, *_ = np.linalg.lstsq(terms, left, rcond=None)
    means = [block.mean() for block in np.array_split(left - terms @ fitted, BLOCKS)]
    return float(fitted[0]), float(np.std(means, ddof=1) / np.sqrt(BLOCKS))
