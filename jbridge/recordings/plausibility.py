"""Refusals of channels that are plainly in another unit or of another sign than declared.

Sizes show a unit: no laboratory's rail is 20 m long. Signs, and units that sizes leave open, show in the laws of
motion (`laws_of_motion`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from jbridge.errors import InputError
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import SLOWEST, TOO_FAST, excess_of_angle
from jbridge.recordings.laws_of_motion import CELL, Samples, is_swapped, misread_swing, runs_backwards
from jbridge.recordings.recording import MEASURED, Recording
from jbridge.recordings.tables.columns import UNITS

LONGEST = 20.0
"""Way of a cart or length of a rope [m] that no laboratory has, and speed that no cart reaches [m/s]."""
FORCE = "; --force takes it as it is"
"""What to do if what is doubted is right."""


def doubtful_names(channels: Channels, locked: bool) -> Iterator[InputError]:
    """Yields the refusals of columns that are nearly called like a channel that is missing and needed.

    Args:
        channels: of the recording.
        locked: whether the rope's length is declared.
    """
    there, near = channels.values.keys(), channels.near.keys()
    # Where an axis lacks its partner the recording is refused in any case.
    needed = (
        {"x", "psi"} | ({"u_x"} if "x" in near else set()) | ({"l"} if not locked and "u_l" not in there else set())
    )
    for channel, column in channels.near.items():
        if channel in needed:
            yield InputError(
                f"{channels.table.header}, column {column.name}: not used, and there is no {channel}; declare"
                f" {column.line(channel)} {place(channels)}, or {channel} = false if it is something else{FORCE}"
            )


def doubtful_units(channels: Channels) -> Iterator[InputError]:
    """Yields the refusals of times, positions and lengths that are too large for seconds and metres."""
    times = channels.values["t"]
    step = float(np.median(np.diff(times)))
    if step > SLOWEST:
        unit = "ms" if 1e-3 * step <= SLOWEST else "us"
        yield refusal(channels, "t", f"a row every {step:.4g} s is no recording of a swing", unit=unit)
        return
    for name in ("x", "l"):
        values = channels.values.get(name)
        if values is None:
            continue
        size = float(np.ptp(values) if name == "x" else np.max(values))
        shift = max(CELL, 2 * step)
        later = np.interp(np.minimum(times + shift, times[-1]), times, values)
        speed = float(np.quantile(np.abs(later - values), 0.9)) / shift
        if max(size, speed) > LONGEST:
            what = f"{size:.4g} m is longer than any laboratory"
            if size <= LONGEST:
                what = f"{speed:.3g} m/s is faster than any cart"
            # Rails and ropes of laboratories have some decimetres to a few metres.
            unit = "cm" if size < 200 else "mm" if size < 20_000 else "um"
            yield refusal(channels, name, what, unit=unit)


def doubtful_angle(channels: Channels, locked_length: float | None) -> Iterator[InputError]:
    """Yields the refusal of an angle that accelerates as no load does: one in degrees or milliradians."""
    values = channels.values
    length = values.get("l", locked_length)
    if "psi" not in values or length is None:
        return
    excess = excess_of_angle(values["t"], values["psi"], values.get("x"), np.broadcast_to(length, values["t"].shape))
    if excess > TOO_FAST:
        far = float(np.abs(values["psi"] - np.median(values["psi"])).max())
        # Degrees read as radians turn 180 / pi times too fast at most, for a length wrong by two twice that.
        unit, called = ("deg", "degrees") if excess < TOO_FAST * 180 / np.pi else ("mrad", "milliradians")
        what = f"a swing of {far:.4g} rad, {excess:.0f} times as fast as gravity and the cart can make it"
        yield refusal(channels, "psi", f"{what}, is in {called}", unit=unit)


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
    x, psi, l = (samples.get(name) for name in ("x", "psi", "l"))
    if l is None and locked_length is not None:
        l = times[[0, -1]], np.full(2, locked_length)
    if x is not None and psi is not None and l is not None and is_swapped(times, psi, x, l):
        yield exchange(channels, "x", "psi")
        return
    swing = None if psi is None or l is None else misread_swing(times, psi, x, l)
    if swing is not None and swing.unit:
        yield refusal(channels, "x", "the cart moves too far for the swing of its load", unit=swing.unit)
        return
    swapped = list(exchanged_axes(channels, samples))
    if swapped:
        yield from swapped
        return
    against = x is not None and "u_x" in values and runs_backwards(times, values["u_x"], x, psi)
    turned = swing is not None and swing.turned
    if turned and against:
        yield refusal(channels, "x", "it goes against its input and against the swing of the load", turned=True)
    elif against:
        yield refusal(channels, "u_x", "the cart moves against it at every delay", turned=True)
    elif turned:
        yield refusal(channels, "psi", "the load swings to where the cart accelerates, against gravity", turned=True)
    if "l" in samples and "u_l" in values and runs_backwards(times, values["u_l"], samples["l"], None):
        yield refusal(channels, "u_l", "the rope's length moves against it at every delay", turned=True)


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
        yield exchange(channels, *(("u_x", "u_l") if swing_holds(times, samples) else ("x", "l")))


def swing_holds(times: np.ndarray, samples: Mapping[str, Samples]) -> bool:
    """Says whether the load's equation is certain to fit the cart as read, so that no other position will do."""
    if "psi" not in samples:
        return True
    turned = misread_swing(times, samples["psi"], (samples["x"][0], -samples["x"][1]), samples["l"])
    return turned is not None and turned.turned


def exchange(channels: Channels, one: str, other: str) -> InputError:
    """Returns the refusal of two channels that have each other's columns."""
    columns = channels.columns
    lines = [
        replace(columns[mine], name=columns[yours].name).line(mine) for mine, yours in ((one, other), (other, one))
    ]
    return InputError(
        f"{channels.table.path}, columns {columns[one].name} and {columns[other].name}: the laws of motion hold with"
        f" the two exchanged, and not as they are; declare {lines[0]} and {lines[1]} {place(channels)}{FORCE}"
    )


def signs_of(recording: Recording) -> dict[str, bool | None]:
    """Returns whether the signs of a recording fit the laws of motion: True if they certainly do, False if they
    certainly do not, None where it does not tell. They do if the other sign would certainly be wrong.
    """
    samples = {name: recording.samples(name) for name in MEASURED if getattr(recording, name) is not None}
    x, psi, l = (samples.get(name) for name in MEASURED)
    if l is None and recording.locked_length is not None:
        l = recording.times[[0, -1]], np.full(2, recording.locked_length)
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


def place(channels: Channels) -> str:
    """Returns where a line of a sidecar belongs."""
    return f"under [columns] in {channels.sidecar}"


def refusal(channels: Channels, channel: str, what: str, *, unit: str = "", turned: bool = False) -> InputError:
    """Returns the refusal of a channel, with the line that declares it otherwise.

    Args:
        channels: of the recording.
        channel: the one to blame.
        what: shows it.
        unit: of what was read, if that is taken for SI now.
        turned: whether the sign is the other one.
    """
    column = channels.columns[channel]
    sizes = UNITS[channel]
    if unit and column.scale is not None:
        mended = replace(column, scale=column.scale * sizes[unit])
    elif unit:
        size = sizes[column.unit] * sizes[unit]
        mended = replace(column, unit=min(sizes, key=lambda name: abs(np.log(sizes[name] / size))))
    else:
        mended = replace(column, sign=-column.sign if turned else column.sign)
    message = f"{what}; declare {mended.line(channel)} {place(channels)}{FORCE}"
    if unit:
        values = channels.values[channel]
        return channels.error(int(np.abs(values - np.median(values)).argmax()), channel, message)
    return InputError(f"{channels.table.path}, column {column.name}: {message}")
