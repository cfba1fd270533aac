"""What a sensor does that nothing on a rig does: it stops from one row to the next, or its zero is not at rest."""

from collections.abc import Iterator, Mapping

import numpy as np

from jbridge.errors import InputError, cut
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import GRAVITY
from jbridge.recordings.hold import Hold
from jbridge.recordings.plausibility.lengths import FINER, locked_line, swung_share
from jbridge.recordings.plausibility.refusals import FORCE, times_more
from jbridge.recordings.plausibility.signs import scale_remedy
from jbridge.recordings.plausibility.swing_equation import (
    CERTAIN,
    STRETCH,
    WORSE,
    Cells,
    Samples,
    best_scale,
    hanging,
    in_cells,
    other_scale,
    rope,
    swing_cells,
    swing_terms,
)

ROWS = 5
"""Rows of one value from which on a sensor stands still."""
BEFORE = 3
"""Rows that show how fast it came."""
LONGER = 3.0
"""Multiple of the time that a motion stays within a count where it reverses."""
COUNTS = 4.0
"""Way in these rows, over the sensor's count or what its noise takes for one, from which on it moved at all."""
FAR = 0.05
"""Angle [rad] that no friction at a pivot holds, and acceleration of a cart over gravity that makes any load swing."""
FARTHEST = 1.0
"""Angle [rad] beyond which a sensor's zero is not near hanging."""
HANGS = "The load hangs at "
"""How a sentence on an angle's zero begins."""
SWINGS = "The load swings "
"""How one on the scale of an angle begins."""
CELL = 0.2
"""Time over which a cart's position is averaged for its acceleration [s]."""


def doubtful_silence(channels: Channels) -> Iterator[InputError]:
    """Yields the refusal of an angle that never changes although the cart speeds up and slows down."""
    times, x, psi = (channels.values.get(name) for name in ("t", "x", "psi"))
    if times is None or x is None or psi is None or np.ptp(psi) > 0:
        return
    cells = in_cells(CELL, times, {"x": (times, x)}, {})
    if cells is None or np.count_nonzero(cells.whole) < STRETCH * CERTAIN**2:
        return
    # A load hangs straight down below a cart of constant speed.
    if np.std(cells.acceleration("x")[cells.whole]) > FAR * GRAVITY:
        name = cut(channels.columns["psi"].name)
        yield InputError(
            f"{channels.table.path}, column {name}: the angle never changes, though the cart moves by"
            f" {np.ptp(x):.2g} m; if nothing swings or its sensor is dead, declare psi = false under"
            f" {channels.place('psi')}{FORCE}"
        )


def sensor_notes(
    channels: Channels,
    samples: Mapping[str, Samples],
    resolution: Mapping[str, float],
    holds: Mapping[str, Hold],
    locked_length: float | None,
) -> list[str]:
    """Returns sentences on sensors that stop dead, and on an angle whose zero is not where the load hangs.

    Args:
        channels: of the recording.
        samples: the fresh samples of each measured channel.
        resolution: size of each channel's count [m, rad].
        holds: of each channel; one that repeats its value says nothing here.
        locked_length: of the rope [m], where there is no `l`.
    """
    notes = []
    l = samples.get("l")
    length = locked_length if l is None else float(np.median(l[1]))
    for name, (times, values) in samples.items():
        if holds[name].held or (name == "psi" and length is None):
            continue
        limit, unit = (GRAVITY / length, "rad") if name == "psi" and length is not None else (GRAVITY, "m")
        rows = dead_stops(times, values, resolution[name], limit)
        if rows.size:
            other = "" if name == "psi" else ", or something runs against a stop"
            notes.append(
                f"{name} stops dead at {values[rows[0]]:.4g} {unit} at {times[rows[0]]:.6g}"
                f" s{times_more(rows.size - 1)}: the sensor's range ends there, or it hangs{other}; leave such"
                " stretches out ([trim], or delete their rows)."
            )
    if "psi" in samples and length is not None:
        times, psi = samples["psi"]
        position, l = samples.get("x", (times, np.zeros(times.size))), rope(times, samples, length)
        if l is not None:
            share = swung_share(times, samples["psi"], position, l)
            cells = swing_cells(times, samples["psi"], position, l)
            found = [] if cells is None or (share or 1.0) < 1.0 / FINER else swing_notes(channels, cells, psi)
            notes += found
            if share is not None and not any(note.startswith(SWINGS) for note in found):
                notes.append(length_note(channels, share, length))
    return notes


def length_note(channels: Channels, share: float, length: float) -> str:
    """Returns the sentence on a load that swings as on a rope that is a share of the length [m] that was read."""
    line = locked_line(channels, length, share)
    wrong = "the scale or the offset of l" if "l" in channels.columns else line
    return (
        f"The load swings as on a rope of {share * length:.3g} m, and not of {length:.3g} m: if the length is wrong,"
        f" declare {wrong}; a rod, or a load as long as its rope, swings otherwise than its length as well."
    )


def swing_notes(channels: Channels, cells: Cells, psi: np.ndarray) -> list[str]:
    """Returns sentences on an angle whose zero is not where the load hangs or whose scale is another one.

    Args:
        channels: of the recording.
        cells: of the swing, as `swing_cells` gives them.
        psi: the angle's samples [rad].
    """
    notes, column = [], channels.columns["psi"]
    angle = hanging(cells)
    if np.mean(np.cos(psi)) > 0 and FAR < abs(angle) < FARTHEST:
        notes.append(
            f"{HANGS}{angle:.2g} rad in the mean; if that is the sensor's zero, declare"
            f" {column.zeroed('psi', angle).line('psi')} under {channels.place('psi')}."
        )
    terms = swing_terms(cells)
    factor = other_scale(terms, WORSE, best_scale(terms)) if "x" in channels.columns else None
    if factor is not None:
        other_way = "" if factor > 0 else ", and the other way"
        notes.append(
            f"{SWINGS}{abs(factor):.3g} times as far as the motion of its cart makes it swing{other_way},"
            f" unless something else moves it: {scale_remedy(channels, factor)}."
        )
    return notes


def dead_stops(times: np.ndarray, values: np.ndarray, resolution: float, limit: float) -> np.ndarray:
    """Returns the first rows of the stretches in which a channel holds one value, `ROWS` rows or more, although it came
    at a speed from which it would have taken more than a row to stop.

    Args:
        times: of the samples [s].
        values: of the channel.
        resolution: size of its count, 0 if it has none.
        limit: deceleration of what moves [unit of the values over s²].
    """
    count = max(resolution, float(np.median(np.abs(np.diff(values, 2)))) if values.size > 2 else 0.0)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    ends = np.append(starts[1:], values.size) - 1
    # What reverses at the limit stays within a count for a while, too.
    turning = np.sqrt(8 * count / limit)
    still = (ends - starts >= ROWS - 1) & (times[ends] - times[starts] > LONGER * turning)
    first = starts[still & (starts >= BEFORE)]
    if not first.size:
        return first
    way, took = np.abs(values[first] - values[first - BEFORE]), times[first] - times[first - BEFORE]
    one_way = np.abs(sum(np.sign(values[first - k] - values[first - k - 1]) for k in range(BEFORE))) == BEFORE
    # It may have braked in the rows before, at the limit, and in the one in which it stopped.
    fastest = limit * (took / 2 + took / BEFORE)
    return first[one_way & (way > COUNTS * count) & (way / took > fastest)]
