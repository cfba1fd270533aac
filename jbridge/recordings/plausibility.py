"""What is plainly in another unit or of another sign than declared, found from the laws that every bridge obeys.

Sizes show a unit: no laboratory's rail is 20 m long. Signs, and units that sizes leave open, show in equations of
motion that hold whatever the rig's masses, gains and friction are:

- of the load, `l psi'' + 2 l' psi' + g sin(psi) + x'' cos(psi) = 0`;
- of a driven axis, `x'' = b u - c x' - d sign(x') + e sin(psi) + f` with `b`, `c`, `d` not negative, or, where the
  drive imposes the speed, `x' = b u + f`.

Each is met by what was read and by what would have been read in another unit or of another sign. What was read is
called wrong only if it leaves four times the squared error (`WORSE`), and if that is no matter of a few moments
(`CERTAIN`). Whatever explains a recording as read, be it badly, stays: noise, friction, rest, a motor that is off, and
motion that both signs explain alike.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from jbridge.errors import InputError
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import GRAVITY, SLOWEST, TOO_FAST, excess_of_angle
from jbridge.recordings.recording import MEASURED, Recording
from jbridge.recordings.tables.columns import UNITS

LONGEST = 20.0
"""Way of a cart or length of a rope [m] that no laboratory has, and speed that no cart reaches [m/s]."""
WORSE = 4.0
"""Squared error that is left, as a multiple of what another reading leaves: twice the rms error."""
CERTAIN = 3.0
"""Sum, over stretches of time, of how plainly each speaks for the other reading, over the root of their sum of
squares. Were each as likely to speak against it, this would be exceeded with a probability of at most exp(-3² / 2) =
1 % (Hoeffding) in each of two ways to weigh them, 0.1 % where many stretches count; the fourfold error comes on top."""
HOLDS = 0.1
"""Share of the forces' mean square up to which an equation holds; those of measured rigs leave 0.1 to 26 %, and
exchanged columns 12 to 99 %."""
STRETCH = 3
"""Cells of time in a stretch: as many as one second difference spans, so that stretches share little noise."""
LATE, LATE_AGAINST = range(8), range(2)
"""Delays that are tried [cells] of a drive as declared, and of one that is turned. A periodic input, and the limit
cycle of a controller with a late drive, look turned once they come half a period late, so that the declared sign has
every chance, and the other one that of a drive that answers at once."""
CELL = 0.1
"""Time over which a driven axis is averaged [s]: well above sampling periods, not above the time constants of carts."""


Samples = tuple[np.ndarray, np.ndarray]
"""Times [s] and values of a channel's samples."""


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


FORCE = "; --force takes it as it is"
"""What to do if what is doubted is right."""


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


@dataclass(frozen=True)
class Misread:
    """How cart and angle would have to be read for the load's equation to hold."""

    unit: str = ""
    """Of the cart's position, where it is not the declared one."""
    turned: bool = False
    """Whether the angle, or the position, has the other sign."""


@dataclass(frozen=True)
class Cells:
    """Channels of a recording as means over equal cells of time, which no noise of single samples shows in."""

    length: float
    """Of a cell [s]."""
    whole: np.ndarray
    """True where a cell, and the two after it, hold no gap."""
    values: Mapping[str, np.ndarray]
    """Mean of each channel by cell."""

    def middle(self, name: str) -> np.ndarray:
        """Returns a channel as seen by the kernel of the second difference, a quadratic B-spline."""
        v = self.values[name]
        return (v[:-2] + 4 * v[1:-1] + v[2:]) / 6

    def rate(self, name: str) -> np.ndarray:
        """Returns the first derivative, by central differences."""
        v = self.values[name]
        return (v[2:] - v[:-2]) / (2 * self.length)

    def acceleration(self, name: str) -> np.ndarray:
        """Returns the second derivative, exact for the mean under the kernel."""
        v = self.values[name]
        return (v[2:] - 2 * v[1:-1] + v[:-2]) / self.length**2


def in_cells(
    length: float,
    times: np.ndarray,
    measured: Mapping[str, Samples],
    inputs: Mapping[str, np.ndarray],
) -> Cells | None:
    """Returns the means over cells of time, or None where the recording has too few.

    Args:
        length: of a cell [s].
        times: of the rows [s].
        measured: times [s] and values of the fresh samples of each channel, straight in between.
        inputs: held from row to row.
    """
    count = int((times[-1] - times[0]) / length)
    if count < STRETCH * CERTAIN**2 or count > 10_000_000:
        return None
    edges = times[0] + length * np.arange(count + 1)
    values = {}
    for name, (moments, samples) in measured.items():
        # The mean of a broken line over a cell, from its integral. Its own samples within a cell count alike.
        grid = np.union1d(edges, moments)
        line = np.interp(grid, moments, samples)
        area = np.concatenate([[0.0], np.cumsum(np.diff(grid) * (line[1:] + line[:-1]) / 2)])
        values[name] = np.diff(area[np.searchsorted(grid, edges)]) / length
    for name, held in inputs.items():
        area = np.concatenate([[0.0], np.cumsum(np.diff(times) * held[:-1])])
        values[name] = np.diff(np.interp(edges, times, area)) / length
    gaps = np.zeros(count, bool)
    for moments in [times, *(moments for moments, _ in measured.values())]:
        steps = np.diff(moments)
        long = steps > max(length, 3 * float(np.median(steps)))
        for start, stop in zip(moments[:-1][long], moments[1:][long], strict=True):
            first, last = np.searchsorted(edges, [start, stop])
            gaps[max(first - 1, 0) : last] = True
    whole = ~(gaps[:-2] | gaps[1:-1] | gaps[2:])
    return Cells(length, whole, values)


def certainly_better(errors: np.ndarray, other: np.ndarray, worse: float = WORSE) -> bool:
    """Says whether `other` leaves plainly smaller errors, and in many stretches of time rather than in a few."""
    if not np.sum(errors**2) > worse * np.sum(other**2):
        return False
    count = errors.size // STRETCH
    these, those = ((e[: count * STRETCH] ** 2).reshape(count, STRETCH).sum(axis=1) for e in (errors, other))
    # Each stretch counts by how plainly it speaks, one at rest hardly; or by how much of the error it shows.
    shares = (these - those) / np.maximum(these + those + those.mean(), 1e-300)
    plainly = [votes.sum() > CERTAIN * np.sqrt(np.sum(votes**2)) for votes in (shares, these - those)]
    return any(plainly)


def swing_errors(cells: Cells, factor: float) -> np.ndarray:
    """Returns what the load's equation leaves [m/s²], if the cart's position is `factor` times what was read.

    -1 stands for another sign of either the position or the angle, which the equation cannot tell apart, and 0 for a
    cart that does not matter. The rope may be up to twice as long or short as declared, and the angle's zero
    anywhere near hanging or near upright.
    """
    psi, l = cells.middle("psi"), cells.middle("l")
    turning = l * cells.acceleration("psi")
    if np.ptp(l) > 0:
        turning = turning + 2 * cells.rate("l") * cells.rate("psi")
    force = GRAVITY * cells.middle("sin")
    if factor:
        force = force + factor * cells.acceleration("x") * np.cos(psi)
    turning, force = turning[cells.whole], force[cells.whole]
    turning, force = turning - turning.mean(), force - force.mean()
    share = -np.dot(turning, force) / max(float(np.dot(turning, turning)), 1e-300)
    of_zeros = [np.clip(share, 0.5, 2.0) * turning + force, np.clip(-share, 0.5, 2.0) * turning - force]
    return min(of_zeros, key=lambda left: float(np.sum(left**2)))


def misread_swing(times: np.ndarray, psi: Samples, x: Samples | None, l: Samples) -> Misread | None:
    """Returns how cart and angle would have to be read for the load's equation to hold, if that is certain.

    Each channel comes as times [s] and values of its samples; `x` is None for a fixed cart. What may be right as it
    was read gives None.
    """
    if x is None:
        return None
    cells = swing_cells(times, psi, x, l)
    if cells is None:
        return None
    readings = {
        Misread(unit, turned): swing_errors(cells, -size if turned else size)
        for unit, size in {"": 1.0, "cm": 0.01, "mm": 0.001}.items()
        for turned in (False, True)
    }
    best = min(readings, key=lambda reading: float(np.sum(readings[reading] ** 2)))
    # The cart must be needed at all: a position that is mere noise is best left out.
    needed = certainly_better(swing_errors(cells, 0.0), readings[best], worse=WORSE / 2)
    return best if needed and certainly_better(readings[Misread()], readings[best]) else None


def swing_cells(times: np.ndarray, psi: Samples, x: Samples, l: Samples) -> Cells | None:
    """Returns a swing in eighths of its period, or None where it is too short to decide anything."""
    period = 2 * np.pi * np.sqrt(float(np.median(l[1])) / GRAVITY)
    cells = in_cells(period / 8, times, {"x": x, "psi": psi, "l": l, "sin": (psi[0], np.sin(psi[1]))}, {})
    return cells if cells is not None and np.count_nonzero(cells.whole) >= STRETCH * CERTAIN**2 else None


def is_swapped(times: np.ndarray, psi: Samples, x: Samples, l: Samples) -> bool:
    """Says whether the load's equation certainly holds with position and angle exchanged, and not as they were read.

    Both are judged by what they leave of their own forces and accelerations, since their sizes differ.
    """
    left = []
    for angle, position in ((psi, x), (x, psi)):
        cells = swing_cells(times, angle, position, l)
        if cells is None:
            return False
        parts = (cells.middle("l") * cells.acceleration("psi"), GRAVITY * cells.middle("sin"), cells.acceleration("x"))
        size = sum(float(np.var(part[cells.whole])) for part in parts)
        errors = min((swing_errors(cells, way) for way in (1.0, -1.0)), key=lambda e: float(np.sum(e**2)))
        left.append(errors / np.sqrt(max(size, 1e-300)))
    as_read, exchanged = left
    return float(np.mean(exchanged**2)) < HOLDS and certainly_better(as_read, exchanged)


def runs_backwards(
    times: np.ndarray,
    u: np.ndarray,
    position: Samples,
    psi: Samples | None,
) -> bool:
    """Says whether an axis certainly moves against its input.

    A drive may move with its input or against it, and answer at once or late. Against it is certain if this leaves
    plainly less than the other at every delay, either of the acceleration or of the speed, and if neither speaks for
    the other.
    """
    if np.ptp(u) == 0:
        return False
    length = max(CELL, 2 * float(np.median(np.diff(position[0]))))
    measured = {"q": position} | ({} if psi is None else {"sin": (psi[0], np.sin(psi[1]))})
    cells = in_cells(length, times, measured, {"u": u})
    if cells is None or np.count_nonzero(cells.whole) < STRETCH * CERTAIN**2:
        return False
    speed = cells.rate("q")
    direction = np.sign(speed) * (np.abs(speed) > 0.05 * np.abs(speed).max())
    load = [] if psi is None else [cells.middle("sin")]
    # A friction, and what the load does, may have any sign where it is not known whether the axis is read turned.
    of_force = against_and_with(cells, cells.acceleration("q"), [-speed, -direction], load)
    of_speed = against_and_with(cells, speed, [], [])
    verdicts = [(certainly_better(w, a), bool(np.sum(w**2) < np.sum(a**2))) for a, w in (of_force, of_speed)]
    return any(against for against, _ in verdicts) and not any(along for _, along in verdicts)


def against_and_with(
    cells: Cells, target: np.ndarray, positive: list[np.ndarray], free: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns what is left of a motion that goes against its input, and of one that goes with it, at the best delay.

    Args:
        cells: of the recording.
        target: the motion.
        positive: what enters with a factor that is not negative.
        free: what enters with any factor.
    """
    late = max(LATE)
    chosen = cells.whole[late:]
    wanted = target[late:][chosen]
    others = [part[late:][chosen] for part in (*positive, *free)] + [np.ones(wanted.size)]
    left: dict[bool, np.ndarray] = {}
    u = cells.middle("u")
    for delay in LATE:
        parts = np.stack([u[late - delay : u.size - delay][chosen], *others], axis=1)
        scale = np.maximum(np.sqrt(np.mean(parts**2, axis=0)), 1e-300)
        triangle = np.asarray(np.linalg.qr(np.column_stack([parts / scale, wanted]), mode="r"))
        count = parts.shape[1]
        for against in (True, False) if delay in LATE_AGAINST else (False,):
            way = np.ones(count)
            way[0] = -1.0 if against else 1.0
            # What may have any factor enters twice, once with each sign.
            both = triangle[:, :count] * way
            found, _ = nnls(np.column_stack([both, -both[:, count - len(free) - 1 :]]), triangle[:, count])
            factors = found[:count]
            factors[count - len(free) - 1 :] -= found[count:]
            errors = wanted - parts @ (way * factors / scale)
            if against not in left or np.sum(errors**2) < np.sum(left[against] ** 2):
                left[against] = errors
    return left[True], left[False]
