"""Sentences for the rig's owner on what a recording's numbers show."""

import numpy as np

from jbridge.recordings.channels import Channels
from jbridge.recordings.dropouts import filled_rows
from jbridge.recordings.hold import Hold
from jbridge.recordings.plausibility.refusals import times_more
from jbridge.recordings.plausibility.units import LEAST, leaping
from jbridge.recordings.sidecar import Sidecar


def describe(channels: Channels, declared: Sidecar, resolution: dict[str, float], holds: dict[str, Hold]) -> list[str]:
    """Returns the sentences on what the numbers themselves show."""
    notes = [f"Declarations come from {declared.source}."] if declared.source else []
    times = channels.values["t"]
    period, longest = float(np.median(np.diff(times))), float(np.diff(times).max())
    if period > 1:
        notes.append(
            f'There is one row per {period:.3g} s; if the time is in ms, declare it: t = {{column = "t", unit = "ms"}}.'
        )
    if longest > 10 * period:
        moment = times[np.diff(times).argmax()]
        notes.append(
            f"The longest gap between rows is {longest:.3g} s, at {moment:.6g} s; inputs are held over it. If another"
            " run begins there, cut the file."
        )
    notes += leap_notes(channels)
    u, x = (channels.values.get(name) for name in ("u_x", "x"))
    if u is not None and x is not None and u.min() >= 0.0 < u.max() and both_ways(x):
        notes.append(
            "u_x is never negative, but the cart goes both ways: declare the reading that is no input as its offset, or"
            " give u_x its sign if the log has it elsewhere."
        )
    for gain, value in channels.gains.items():
        if gain not in declared.override:
            notes.append(f"The unit of the input tells the drive's gain: {gain} = {value:.6g} is known.")
    for name, hold in holds.items():
        size, unit = resolution[name], "rad" if name == "psi" else "m"
        if name not in declared.resolution and size > 0:
            notes.append(f"The values of {name} lie on a grid of {size:.4g} {unit}, taken as its count.")
        if hold.held:
            notes.append(held_note(name, hold, "as declared" if name in declared.hold else "as its motion shows"))
    return notes


def both_ways(x: np.ndarray) -> bool:
    """Says whether a cart goes a tenth of its way, and more than a centimetre, in each direction."""
    least = max(0.1 * float(np.ptp(x)), 0.01)
    return bool(np.max(x - np.minimum.accumulate(x)) > least and np.max(np.maximum.accumulate(x) - x) > least)


def leap_notes(channels: Channels) -> list[str]:
    """Returns sentences on rows that hold the one value of a dropout, and on other leaps, for each channel: a fit goes
    on beside a few of them.

    At 20 rows a second a rig may go so far from one to the next that none is told from motion.
    """
    times, notes = channels.values["t"], []
    for name, limits in LEAST.items():
        values = channels.values.get(name)
        if values is None:
            continue
        unit = "rad" if name == "psi" else "m"
        filled = filled_rows(values, limits[0])
        if filled.any():
            first = int(filled.argmax())
            row = channels.table.row_numbers[channels.rows[first]]
            notes.append(
                f"{name} is {values[first]:.4g} {unit} in {np.count_nonzero(filled)} single rows, first in row {row}"
                f" ({times[first]:.6g} s), far from the rows around them: the sensor or the log had no reading there;"
                " delete these rows, since a gap is a missing row."
            )
        kept, values = times[~filled], values[~filled]
        rows = np.flatnonzero(leaping(kept, values, *limits)) + 1
        if rows.size:
            step = abs(values[rows[0]] - values[rows[0] - 1])
            # A wrong row is one step away from the last and one from the next.
            more = times_more(rows.size - 1) if rows.size > 2 else ""
            notes.append(
                f"{name} leaps by {step:.3g} {unit} in one row at {kept[rows[0]]:.6g} s{more}, as nothing moves:"
                " delete wrong rows; where rows are missing, or another run begins, cut the file."
            )
    return notes


def lost_notes(times: np.ndarray, lost: dict[str, np.ndarray]) -> list[str]:
    """Returns one sentence per channel of which the log lost rows."""
    return [
        f"The log lost {np.count_nonzero(rows)} rows of {name}, the first at {times[rows.argmax()]:.6g} s, and repeated"
        " a neighbour's value while the rig moved on; they are not counted."
        for name, rows in lost.items()
        if rows.any()
    ]


def held_note(name: str, hold: Hold, how: str) -> str:
    rate = f" about every {hold.period * 1000:.0f} ms" if hold.period else ""
    return f"The sensor of {name} gives a new sample{rate} and repeats it in between, {how}; repeats are not counted."
