"""Decides from the channels of a recording which parts the rig has: cart, swing, hoist, or a locked rope."""

from collections.abc import Iterator, Set
from dataclasses import dataclass

import numpy as np

from jbridge.errors import InputError, listed, quoted
from jbridge.recordings.channels import Channels
from jbridge.recordings.sidecar import Sidecar
from jbridge.recordings.tables.columns import Column, plain_column

MOST_MOTION = 0.02
"""A rope whose length varies by more than this [m] is not locked."""


@dataclass(frozen=True)
class Parts:
    """The rope of a recording, and which channels say nothing about a part that is there."""

    locked_length: float | None
    """Length of the locked rope [m]; None with a driven hoist or without a load."""
    unused: frozenset[str]
    """Inputs without a part that they move."""
    notes: tuple[str, ...]


def find_parts(channels: Channels, declared: Sidecar, inputs_only: bool) -> Parts:
    """Returns what the channels say about the parts of the rig.

    - `x` and `u_x` mean a cart. Without `x` the load hangs from a fixed point.
    - `psi`, or `l` beside `x`, means a load that swings.
    - `u_l` means a driven hoist. Without it the rope is locked, at `[locked] l` or at the median of `l`.

    With `inputs_only` measured channels may be absent, since the parts come from a model.

    Raises:
        InputError: where channels contradict each other, or where one is missing.
    """
    for problem in contradictions(channels, declared, inputs_only):
        raise problem
    values = channels.values
    notes: list[str] = []
    unused: set[str] = set()
    if not inputs_only and "u_x" in values and "x" not in values:
        unused.add("u_x")
        notes.append("There is no x, so the load is taken to hang from a fixed point and u_x is not used.")
    if "u_l" in values and declared.locked is None:
        return Parts(None, frozenset(unused), tuple(notes))
    if "u_l" in values:
        unused.add("u_l")
        notes.append("The rope is declared locked, so u_l, which never changes, is not used.")
    length, how = locked_length(channels, declared, inputs_only)
    return Parts(length, frozenset(unused), (*notes, how) if how else tuple(notes))


def contradictions(
    channels: Channels, declared: Sidecar, inputs_only: bool, supposed: frozenset[str] = frozenset()
) -> Iterator[InputError]:
    """Yields the refusals of channels that contradict each other, or that lack another one.

    Args:
        channels: of the recording.
        declared: about it.
        inputs_only: whether measured channels may be absent.
        supposed: channels that are missing, but count as there.
    """
    values, header = channels.values, channels.table.header
    there = values.keys() | supposed
    if "x" in there and "u_x" not in there:
        said = "a column x" if "x" in values else "x"
        yield InputError(
            f"{header}: {said} but no u_x; add the input of the cart's drive (zeros if the motor was off)"
            f", or declare {line_for('u_x', channels)} under {channels.place('u_x')}"
        )
    if not inputs_only and not there & {"x", "psi", "l"}:
        others = f"; columns not used are {listed(map(quoted, channels.extras))}" if channels.extras else ""
        yield InputError(f"{header}: nothing measured; add a column x (with u_x), psi, or l (with u_l){others}")
    elif not inputs_only and not there & {"x", "psi", "u_l"}:
        yield InputError(f"{header}: a rope length l, but nothing that moves; add u_l for a hoist, or psi for a swing")
    if "u_l" in values and declared.locked is not None and np.ptp(values["u_l"]) > 0:
        yield InputError(
            f"{header}: u_l varies, but {declared.source} declares a locked rope; remove [locked], or"
            " declare u_l = false under [columns], which leaves the input out"
        )
    elif "u_l" not in there or declared.locked is not None:
        yield from doubtful_lock(channels, declared, inputs_only, there)
    elif "l" not in there and not inputs_only:
        yield InputError(
            f"{header}: a column u_l but no l; add the rope length, or declare {line_for('l', channels)}"
            f" under {channels.place('l')}; if the rope was locked, declare u_l = false there, and its length in"
            " m, such as l = 0.7, under [locked]"
        )


def line_for(channel: str, channels: Channels) -> str:
    """Returns the line that maps a missing channel, to the column that is nearly called so if there is one."""
    column = channels.near.get(channel, Column("...", plain_column(channel).unit))
    return column.line(channel)


def doubtful_lock(channels: Channels, declared: Sidecar, inputs_only: bool, there: Set[str]) -> Iterator[InputError]:
    """Yields the refusal of a locked rope whose length varies, or is not known; `there` are the channels."""
    length, initial = channels.values.get("l"), inputs_only and "l" in declared.initial
    if length is not None and np.ptp(length) > MOST_MOTION:
        middle = np.median(length)
        yield channels.error(
            int(np.abs(length - middle).argmax()),
            "l",
            f"without u_l the rope is locked, but its length varies by {np.ptp(length) * 1000:.0f} mm, over"
            f" {MOST_MOTION * 1000:.0f}; declare the hoist's input, {line_for('u_l', channels)}, under"
            f" {channels.place('u_l')}, or l = false there, and the rope's length in m, such as"
            " l = 0.7, under [locked]",
        )
    elif "psi" in there and "l" not in there and declared.locked is None and not initial:
        yield InputError(
            f"{channels.table.header}: psi without l and u_l means a locked rope of unknown length; declare it, from"
            f" pivot to load centre in m, such as l = 0.7, under {channels.place('l', 'locked')}"
        )


def locked_length(channels: Channels, declared: Sidecar, inputs_only: bool) -> tuple[float | None, str]:
    """Returns the length of a locked rope [m], if a load is there, and a sentence on where it comes from."""
    values = channels.values
    length = values.get("l")
    load = "psi" in values or length is not None
    if not load and not inputs_only:
        ignored = " [locked] is not used." if declared.locked is not None else ""
        return None, f"There is neither psi nor l, so the cart is taken to be alone.{ignored}"
    if declared.locked is not None:
        return declared.locked, f"The rope is locked at {declared.locked:g} m, as declared."
    if length is not None:
        middle = float(np.median(length))
        return middle, (
            f"There is no u_l, so the rope is taken as locked at {middle:.4g} m, the median of l, which"
            f" varies by {np.ptp(length) * 1000:.2g} mm."
        )
    if inputs_only and "l" in declared.initial:
        start = declared.initial["l"]
        return start, f"There is no u_l, so the rope is taken as locked at its initial length, {start:g} m."
    return None, ""
