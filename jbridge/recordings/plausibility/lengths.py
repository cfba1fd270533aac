"""The length of the rope that a load swings on, as its equation of motion shows it."""

from collections.abc import Iterator
from math import isclose

import numpy as np

from jbridge.errors import InputError
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import LONGEST
from jbridge.recordings.plausibility.drive_equation import HOLDS
from jbridge.recordings.plausibility.refusals import FORCE
from jbridge.recordings.plausibility.swing_equation import Samples, certainly_better, swing_cells, swing_terms

SHORTEST = 0.05
"""Length of a rope [m] below which no laboratory has one."""
SLIPS = (1e-3, 1e-2, 1e-1)
"""What a length over the one that was read is, where its unit is another one."""
LIKE = 0.2
"""Relative distance up to which a length is taken for one of them."""
FINER = 3.0
"""Factor of the length up to which cells of time suit a swing."""


def doubtful_length(channels: Channels, locked_length: float | None) -> Iterator[InputError]:
    """Yields the refusal of a declared length of the rope that no laboratory has."""
    length = channels.declared.locked
    if length is None or length != locked_length or length <= LONGEST:
        return
    times, psi, x = (channels.values.get(name) for name in ("t", "psi", "x"))
    share = None
    if times is not None and psi is not None:
        position = (times, np.zeros(times.size) if x is None else x)
        share = swung_share(times, (times, psi), position, (times[[0, -1]], np.full(2, length)))
    # Ropes of laboratories have some decimetres to a few metres.
    share = (1e-2 if length < 200 else 1e-3) if share is None else share
    yield InputError(
        f"{channels.table.path}: a locked rope of {length:g} m is longer than any laboratory; declare its length in m,"
        f" such as {locked_line(channels, length, share)}{FORCE}"
    )


def locked_line(channels: Channels, length: float, share: float) -> str:
    """Returns what to declare for a locked rope that is a share of the length [m] that was read, and where."""
    share = next((slip for slip in SLIPS if isclose(slip, share, rel_tol=LIKE)), share)
    return f"l = {share * length:.3g} under {channels.place('l', 'locked')}"


def swung_share(times: np.ndarray, psi: Samples, x: Samples, l: Samples, *, holding: bool = False) -> float | None:
    """Returns the length on which the load swings over the one read, if it certainly is another one.

    A swing that is much faster than that on the rope as read does not show in its eighths of a period. It is looked for
    in shorter ones, too, in which the equation must then hold; with `holding` it must in any case.
    """
    for size in (*SLIPS, 1.0):
        cells = swing_cells(times, psi, x, l, size)
        if cells is None:
            continue
        terms = swing_terms(cells)
        force = terms.force()
        share = terms.share(force)
        as_read, otherwise = (each * terms.turning + force for each in (1.0, share))
        holds = bool(np.mean(otherwise**2) < HOLDS * np.mean(force**2))
        fits = size / FINER < share < size * FINER and holds if size < 1.0 else holds or not holding
        suits = share * float(np.median(l[1])) > SHORTEST and fits
        if suits and certainly_better(as_read, otherwise):
            return share
    return None
