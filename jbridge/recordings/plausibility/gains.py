"""Gains of drives, as the motion shows them: one rig has one, and its model says about how large it is.

No motion tells in what unit an input is: volts and millivolts differ by a gain, and every rig has its own. What a
recording is held against is therefore another recording of the same rig, or the model.
"""

from collections.abc import Mapping, Sequence
from math import isclose

import numpy as np

from jbridge.errors import InputError
from jbridge.recordings.plausibility.drive_equation import FOLLOWS, axis_cells, responses
from jbridge.recordings.plausibility.refusals import FORCE
from jbridge.recordings.recording import INPUTS, Recording
from jbridge.recordings.tables.columns import BASE_UNITS, GAINS, UNITS

LAWS = ("force", "speed")
"""What a drive may impose: a force, so that the acceleration follows the input, or a speed."""
KNOWN, GUESSED, FAR = 8.0, 30.0, 300.0
"""Ratio from which on a rig moves more per unit of an input than a known gain predicts, from which on a guess is far
off, and from which on, in either direction, units are the likelier reason: what a limit, a dead zone or dry friction
keeps back of a motion is up to 50 times what they let pass."""


def drive_gains(recording: Recording, name: str) -> dict[str, float]:
    """Returns the motion per unit of an input (`u_x` or `u_l`), by law, for the laws that the recording follows.

    The gain of the law of force is in m/s² per unit, that of the law of speed in m/s per unit.
    """
    axis = {"u_x": "x", "u_l": "l"}[name]
    u = getattr(recording, name)
    if u is None or getattr(recording, axis) is None or np.ptp(u) == 0:
        return {}
    psi = recording.samples("psi") if name == "u_x" and recording.psi is not None else None
    cells = axis_cells(recording.times, {"u": u}, {"q": recording.samples(axis)}, psi)
    if cells is None:
        return {}
    return {
        law: each.gain
        for law, each in zip(LAWS, responses(cells), strict=True)
        if each.gain > 0 and float(np.mean(each.along**2)) < FOLLOWS * float(np.var(each.motion))
    }


def contradiction(
    found: Mapping[str, float], expected: Mapping[str, float], limit: float, less: float | None = None
) -> float | None:
    """Returns how many times larger gains are than expected, if each law that tells says that they contradict.

    Args:
        found, expected: gains by law.
        limit: ratio from which on they do.
        less: the same where fewer are found than expected; by default that limit.
    """
    ratios = [found[law] / expected[law] for law in LAWS if law in found and expected.get(law, 0.0) > 0]
    if ratios and (min(ratios) > limit or max(ratios) < 1 / (less or limit)):
        return min(ratios, key=lambda ratio: abs(np.log(ratio)))
    return None


def remedy(recording: Recording, name: str, ratio: float) -> str:
    """Returns what to declare where a rig moves `ratio` times as much per unit of an input as it should."""
    unit = recording.units[name]
    smaller = next((small for small, base in BASE_UNITS.items() if base == unit), None)
    if smaller and isclose(np.log10(ratio), np.log10(UNITS[name][smaller]), abs_tol=1.0):
        unit = smaller
    else:
        unit = "..."
    return f'declare {name} = {{column = "...", unit = "{unit}"}} under [columns] of its sidecar'


def check_gains(names: Sequence[object], recordings: Sequence[Recording]) -> None:
    """Raises an InputError where an input moves its axis far more, or less, than in the other recordings of the rig.

    The one to blame is that which differs from most others, the later one of two. What a sidecar's `[override]` says of
    a gain explains a difference.

    Args:
        names: what the recordings are called.
        recordings: of one rig.
    """
    for name in INPUTS:
        gains = [(drive_gains(recording, name), recording.override.get(GAINS[name])) for recording in recordings]
        against = [
            [contradiction(one, other, FAR) if own == others else None for other, others in gains] for one, own in gains
        ]
        counts = [sum(ratio is not None for ratio in row) for row in against]
        if not any(counts):
            continue
        worst = max(range(len(counts)), key=lambda i: (counts[i], i))
        other = next(i for i, ratio in enumerate(against[worst]) if ratio is not None)
        ratio, unit = against[worst][other], recordings[worst].units[name]
        assert ratio is not None
        raise InputError(
            f"{names[worst]}, column {name}: the rig moves {ratio:.2g} times as much per {unit} as in {names[other]};"
            f" {remedy(recordings[worst], name, ratio)}, or correct the numbers{FORCE}"
        )


def check_units(names: Sequence[object], recordings: Sequence[Recording]) -> None:
    """Raises an InputError where recordings, called by these names, give one input in two units."""
    for name in INPUTS:
        first: dict[str, object] = {}
        for path, recording in zip(names, recordings, strict=True):
            unit = recording.units.get(name)
            if unit and first and unit not in first:
                other, before = next(iter(first.items()))
                raise InputError(
                    f"{path}, column {name}: in {unit}, but in {other} in {before}; a gain has one unit:"
                    " declare the same for all recordings"
                )
            if unit:
                first.setdefault(unit, path)
