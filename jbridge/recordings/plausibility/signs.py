"""Channels of another sign, scale or zero than declared, and columns that are exchanged, found from the equations of
motion."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import copysign, isclose

import numpy as np

from jbridge.errors import InputError, cut
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import GRAVITY
from jbridge.recordings.plausibility.drive_equation import HOLDS, is_input, runs_backwards, unfelt_rows
from jbridge.recordings.plausibility.refusals import FORCE, refusal
from jbridge.recordings.plausibility.swing_equation import (
    Cells,
    Samples,
    certainly_better,
    falls_away,
    hanging,
    likelier_sign,
    misread_swing,
    rope,
    swing_cells,
    swing_terms,
)
from jbridge.recordings.recording import MEASURED, Recording
from jbridge.recordings.tables.columns import UNITS

LIKE = 0.1
"""Relative distance up to which a scale that the load's equation asks for is taken for that of a unit."""
AXIS_OF_INPUT = (("u_x", "x", "psi"), ("u_l", "l", ""))
"""Each input with the channel of the axis that it drives, and with the angle of what hangs there."""


def doubtful_signs(
    channels: Channels, samples: Mapping[str, Samples], locked_length: float | None
) -> Iterator[InputError]:
    """Yields the refusals of channels that contradict the laws of motion as they are read, but not otherwise.

    Args:
        channels: of the recording.
        samples: the fresh samples of each measured channel.
        locked_length: of the rope [m], where there is no `l`.
    """
    times, values = channels.values["t"], channels.values
    x, psi, l = samples.get("x"), samples.get("psi"), rope(times, samples, locked_length)
    if x is not None and psi is not None and l is not None and is_swapped(times, psi, x, l):
        yield exchange(channels, "x", "psi")
        return
    swing = None if psi is None or x is None or l is None else misread_swing(times, psi, x, l, unit_factors(channels))
    if swing is not None and swing.factor != 1:
        yield contradicted_scale(channels, swing.factor)
        return
    swapped = [*exchanged_inputs(channels, samples, l), *exchanged_axes(channels, samples)]
    if swapped:
        yield from swapped
        return
    yield from unfelt_inputs(channels, samples)
    against = x is not None and "u_x" in values and runs_backwards(times, values["u_x"], x, psi)
    turned = swing is not None and swing.turned
    if turned and against:
        yield refusal(channels, "x", "it goes against its input and against the swing of the load", turned=True)
    elif against:
        yield refusal(channels, "u_x", "the cart moves against it at every delay", turned=True)
    elif psi is not None and l is not None:
        yield from doubtful_angle(channels, swing_cells(times, psi, x or (times, np.zeros(times.size)), l), turned)
    if "l" in samples and "u_l" in values and runs_backwards(times, values["u_l"], samples["l"], None):
        yield refusal(channels, "u_l", "the rope's length moves against it at every delay", turned=True)


def doubtful_angle(channels: Channels, cells: Cells | None, turned: bool) -> Iterator[InputError]:
    """Yields the refusal of an angle that has the other sign, or a zero that is upright.

    Args:
        channels: of the recording.
        cells: of the swing; None where it is too short to decide anything.
        turned: whether the angle has the other sign.
    """
    way, column = -1.0 if turned else 1.0, channels.columns["psi"]
    what = ["swings to where the cart accelerates, against gravity"] if turned else []
    if cells is not None and falls_away(cells, way):
        # The line has a sign in any case: the likelier one, where neither is certain.
        way = way if turned else likelier_sign(cells)
        column = column.zeroed("psi", hanging(cells, upright=True, way=way))
        what.append("falls away from 0 as from upright")
    if what:
        mended = replace(column, sign=way * column.sign).line("psi")
        yield InputError(
            f"{channels.table.path}, column {cut(column.name)}: the load {', and '.join(what)}; declare {mended} under"
            f" {channels.place('psi')}{FORCE}"
        )


def unit_factors(channels: Channels) -> set[float]:
    """Returns by what the position may be too small in comparison with the angle, if the unit of either is wrong."""
    x, psi = channels.columns["x"], channels.columns["psi"]
    sizes = UNITS["x"].values()
    found = {0.01, 0.001} if x.scale is not None else {size / UNITS["x"][x.unit] for size in sizes}
    if psi.scale is None:
        found.add(UNITS["psi"][psi.unit])
    return {factor for factor in found if 0.9e-3 < factor < 1.1e3 and factor != 1.0}


def contradicted_scale(channels: Channels, factor: float) -> InputError:
    """Returns the refusal of a cart and a load of which one moves too far for the other.

    Args:
        channels: of the recording.
        factor: by which the position is too small, or the angle too large.
    """
    x, psi = channels.columns["x"], channels.columns["psi"]
    sizes = UNITS["psi"]
    if psi.scale is None and any(isclose(sizes[psi.unit] / factor, other, rel_tol=LIKE) for other in sizes.values()):
        how = "little" if factor < 1 else "far"
        return refusal(channels, "psi", f"the load swings too {how} for the way of its cart", factor=1 / factor)
    far = f"{max(factor, 1 / factor):.3g} times too {'little' if factor > 1 else 'far'}"
    size = x.size("x")
    if x.scale is None and any(isclose(factor * size, other, rel_tol=LIKE) for other in UNITS["x"].values()):
        return refusal(channels, "x", f"the cart moves {far} for the swing of its load", factor=factor)
    return InputError(
        f"{channels.table.path}, columns {cut(x.name)} and {cut(psi.name)}: the cart moves {far} for the swing of its"
        f" load; {scale_remedy(channels, factor)}{FORCE}"
    )


def scale_remedy(channels: Channels, factor: float) -> str:
    """Returns what to declare where the position is too small by a factor, or the angle too large; it is negative where
    the sign is wrong as well."""
    mended = []
    for name, by in (("x", abs(factor)), ("psi", 1.0 / abs(factor))):
        column = channels.columns[name]
        sign, scale = copysign(column.sign, column.sign * factor), float(f"{by * column.size(name):.3g}")
        mended.append(replace(column, unit="count", scale=scale, sign=sign).line(name))
    return (
        f"declare {mended[0]} if the position is wrong, or {mended[1]} if the angle is, under"
        f" {places(channels, 'x', 'psi')}"
    )


def unfelt_inputs(channels: Channels, samples: Mapping[str, Samples]) -> Iterator[InputError]:
    """Yields the refusals of rows whose input stands far out and is certain not to have moved its axis."""
    for name, axis, load in AXIS_OF_INPUT:
        if name not in channels.values or axis not in samples:
            continue
        u = channels.values[name]
        rows = unfelt_rows(channels.values["t"], u, samples[axis], samples.get(load))
        if rows.size:
            more = " is" if rows.size == 1 else f", like {rows.size - 1} more, is"
            yield channels.error(
                int(rows[0]),
                name,
                f"{u[rows[0]]:.4g} {channels.units[name]}{more} far beyond all others, and the rig does not move that"
                f" way; correct the value, or delete the row, since the one above is then held{FORCE}",
            )


def exchanged_inputs(channels: Channels, samples: Mapping[str, Samples], l: Samples | None) -> Iterator[InputError]:
    """Yields the refusal of an input and a position that certainly have each other's columns."""
    times, psi = channels.values["t"], samples.get("psi")
    for name, axis, load in AXIS_OF_INPUT:
        if name not in channels.values or axis not in samples:
            continue
        if is_input(times, channels.values[name], samples[axis], samples.get(load)):
            if axis == "x" and psi is not None and l is not None and swing_holds(times, psi, samples["x"], l):
                continue
            yield exchange(channels, name, axis)


def exchanged_axes(channels: Channels, samples: Mapping[str, Samples]) -> Iterator[InputError]:
    """Yields the refusal of inputs, or else positions, of cart and hoist if each certainly moves with the other's."""
    times, values = channels.values["t"], channels.values
    if not {"u_x", "u_l"} <= values.keys() or not {"x", "l"} <= samples.keys():
        return
    x, l = samples["x"], samples["l"]
    own, other = (
        [runs_backwards(times, -values[u], position, None) for u, position in pairs]
        for pairs in ((("u_x", x), ("u_l", l)), (("u_x", l), ("u_l", x)))
    )
    if all(other) and not any(own):
        holds = "psi" not in samples or swing_holds(times, samples["psi"], x, l)
        yield exchange(channels, *(("u_x", "u_l") if holds else ("x", "l")))


def swing_holds(times: np.ndarray, psi: Samples, x: Samples, l: Samples) -> bool:
    """Says whether the load's equation is certain to fit the cart as read, so that no other position will do."""
    turned = misread_swing(times, psi, (x[0], -x[1]), l)
    return turned is not None and turned.turned


def is_swapped(times: np.ndarray, psi: Samples, x: Samples, l: Samples) -> bool:
    """Says whether the load's equation certainly holds with position and angle exchanged, and not as they were read.

    Both are judged by what they leave of their own forces and accelerations, since their sizes differ.
    """
    if np.ptp(psi[1]) == 0 or np.ptp(x[1]) == 0:
        return False  # what stands still fits every equation
    left = []
    for angle, position in ((psi, x), (x, psi)):
        cells = swing_cells(times, angle, position, l)
        if cells is None:
            return False
        parts = (cells.middle("l") * cells.acceleration("psi"), GRAVITY * cells.middle("sin"), cells.acceleration("x"))
        size = sum(float(np.var(part[cells.whole])) for part in parts)
        errors = min((swing_terms(cells).errors(way) for way in (1.0, -1.0)), key=lambda e: float(np.sum(e**2)))
        left.append(errors / np.sqrt(max(size, 1e-300)))
    as_read, exchanged = left
    return float(np.mean(exchanged**2)) < HOLDS and certainly_better(as_read, exchanged)


def places(channels: Channels, *names: str) -> str:
    """Returns where the lines of several channels belong, in their order; once where it is one place."""
    return " and ".join(dict.fromkeys(map(channels.place, names)))


def exchange(channels: Channels, one: str, other: str) -> InputError:
    """Returns the refusal of two channels that have each other's columns."""
    columns = channels.columns
    lines = [
        replace(columns[mine], name=columns[yours].name).line(mine) for mine, yours in ((one, other), (other, one))
    ]
    names = " and ".join(cut(columns[channel].name) for channel in (one, other))
    return InputError(
        f"{channels.table.path}, columns {names}: the laws of motion hold with the two exchanged, and not as they are;"
        f" declare {lines[0]} and {lines[1]} under {places(channels, one, other)}{FORCE}"
    )


def signs_of(recording: Recording) -> dict[str, bool | None]:
    """Returns whether the signs of a recording fit the laws of motion: True if they certainly do, False if they
    certainly do not, None where it does not tell. They do if the other sign would certainly be wrong.
    """
    samples = {name: recording.samples(name) for name in MEASURED if getattr(recording, name) is not None}
    x, psi, l = samples.get("x"), samples.get("psi"), rope(recording.times, samples, recording.locked_length)
    found: dict[str, bool | None] = {}
    if x is not None and psi is not None and l is not None:
        as_read, turned = (misread_swing(recording.times, psi, (x[0], way * x[1]), l) for way in (1, -1))
        found["psi"] = decided(turned is not None and turned.turned, as_read is not None and as_read.turned)
    for name, position, load in (("u_x", x, psi), ("u_l", samples.get("l"), None)):
        u = getattr(recording, name)
        if u is not None and position is not None:
            backwards = [runs_backwards(recording.times, way * u, position, load) for way in (1, -1)]
            found[name] = decided(backwards[1], backwards[0])
    return found


def decided(right: bool, wrong: bool) -> bool | None:
    """Returns a decision, or None where neither side was certain."""
    return None if right == wrong else right
