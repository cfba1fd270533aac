"""Inputs that were not logged, or whose logged value is outdated: an axis moves without them, or not with them."""

from collections.abc import Iterator, Mapping

import numpy as np

from jbridge.errors import InputError, cut
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import GRAVITY
from jbridge.recordings.parts import MOST_MOTION
from jbridge.recordings.plausibility.drive_equation import CELL
from jbridge.recordings.plausibility.refusals import FORCE
from jbridge.recordings.plausibility.swing_equation import Cells, Samples, in_cells, rope

AXES = {"u_x": "x", "u_l": "l"}
"""The axis that each input drives."""
SLOW, FAST = 0.02, 0.1
"""Speed of an axis [m/s] below which it rests, and above which it is driven."""
WAY = 0.02
"""Way [m] after a rest that is no slack."""
HANGS = 0.5
"""Cosine of the angle around which a load swings that hangs, wherever the zero of its sensor is."""
HELD = 1.0
"""Time for which an input holds and its axis rests [s] from which on it may be outdated."""


def shared_columns(channels: Channels) -> Iterator[InputError]:
    """Yields the refusals of an input and a position that are read from one column."""
    for name, axis in AXES.items():
        if {name, axis} <= channels.columns.keys() and channels.columns[name].name == channels.columns[axis].name:
            column = cut(channels.columns[axis].name)
            yield InputError(
                f"{channels.table.path}, column {column}: it is read as {name} and as {axis}, but no position is its"
                f' own input; declare {name} = {{column = "...", unit = "..."}} under {channels.place(name)}{FORCE}'
            )


def unlogged_inputs(
    channels: Channels, samples: Mapping[str, Samples], locked_length: float | None
) -> Iterator[InputError]:
    """Yields the refusals of inputs that are zero throughout, although something drives their axis.

    Args:
        channels: of the recording.
        samples: the fresh samples of each measured channel.
        locked_length: of the rope [m], where there is no `l`.
    """
    times, psi = channels.values["t"], samples.get("psi")
    l = rope(times, samples, locked_length)
    for name, axis in AXES.items():
        u = channels.values.get(name)
        if u is None or axis not in samples or np.any(u != 0):
            continue
        if goes_up(times, samples["l"]) if axis == "l" else gains_energy(times, samples["x"], psi, l):
            yield InputError(
                f"{channels.table.path}, column {cut(channels.columns[name].name)}: it is 0 throughout, but something"
                f" drives {axis}, by {np.ptp(samples[axis][1]):.2g} m: the input was not logged; declare the column"
                f' that has it, {name} = {{column = "...", unit = "..."}}, under {channels.place(name)}, or leave out'
                f" what was driven, {name} = false and {axis} = false there, or [trim]{FORCE}"
            )


def gains_energy(times: np.ndarray, x: Samples, psi: Samples | None, l: Samples | None) -> bool:
    """Says whether a cart speeds up while its load gains energy, too, which nothing but a drive does.

    Friction takes of both, whatever the masses are; what one of them gains is the other's.
    """
    if psi is not None and (l is None or np.cos(np.median(psi[1])) < HANGS):
        return False
    load = {} if psi is None or l is None else {"psi": psi, "l": l}
    cells = in_cells(CELL, times, {"x": x, **load}, {})
    if cells is None:
        return False
    speed = cells.rate("x")
    if not load:
        return rises(cells, cells.middle("x"), np.abs(speed), np.zeros(speed.size))
    angle, length, turning = cells.middle("psi"), cells.middle("l"), cells.rate("psi")
    upwards, height = length * turning * np.sin(angle), length * (1 - np.cos(angle))
    # The angle's sign may be the wrong one.
    across = [speed + way * length * turning * np.cos(angle) for way in (1.0, -1.0)]
    energies = [(each**2 + upwards**2) / 2 + GRAVITY * height for each in across]
    # A rope that is wound makes a swing larger, and the cart goes with the load, but no further than that.
    reach = float(np.ptp(length * np.sin(angle))) if np.ptp(length) > MOST_MOTION else 0.0
    return all(rises(cells, cells.middle("x"), np.abs(speed), energy, max(WAY, reach)) for energy in energies)


def goes_up(times: np.ndarray, l: Samples) -> bool:
    """Says whether a rope comes in, which its load, and friction, never do by themselves."""
    cells = in_cells(CELL, times, {"l": l}, {})
    return cells is not None and rises(cells, cells.middle("l"), -cells.rate("l"), np.zeros(cells.whole.size))


def rises(cells: Cells, position: np.ndarray, speed: np.ndarray, energy: np.ndarray, way: float = WAY) -> bool:
    """Says whether an axis begins to move after a rest, goes on for some way, and nothing else has lost energy by that.

    Args:
        cells: of the recording.
        position: of the axis by cell [m].
        speed: of it [m/s], where it counts.
        energy: of its load, over the load's mass [m²/s²].
        way: that it goes at least [m].
    """
    rest: int | None = None
    count = 0
    for now in range(speed.size):
        if not cells.whole[now]:
            rest, count = None, 0
        elif rest is None or speed[now] < min(SLOW, speed[rest]) or (speed[now] < SLOW and energy[now] < energy[rest]):
            rest = now
        elif speed[now] > FAST and speed[rest] < SLOW and energy[now] >= 2 * energy[rest]:
            count += bool(abs(position[now] - position[rest]) > way)
    return count > 1


def stale_notes(channels: Channels, samples: Mapping[str, Samples], resolution: Mapping[str, float]) -> list[str]:
    """Returns sentences on inputs that hold for a second or more beside an axis that rests, though less moves it."""
    times, notes = channels.values["t"], []
    for name, axis in AXES.items():
        u = channels.values.get(name)
        if u is None or axis not in samples or np.ptp(u) == 0:
            continue
        for first, last in stale_rows(times, u, samples[axis], resolution[axis]):
            begin, end = float(times[first]), float(times[last])
            trim = [f"start = {end:.6g}"] if first == 0 else [f"stop = {begin:.6g}"]
            trim += [f"start = {end:.6g}"] if 0 < first and last < times.size - 1 else []
            unit = channels.units[name]
            notes.append(
                f"{name} holds {u[first]:.4g} {unit} from {begin:.6g} to {end:.6g} s while {axis} rests, though less"
                " moves it elsewhere: the logged value is outdated, unless the axis stands against a stop;"
                f" {' or '.join(trim)} under {channels.place('', 'trim')} leaves it out."
            )
    return notes


def stale_rows(times: np.ndarray, u: np.ndarray, position: Samples, resolution: float) -> list[tuple[int, int]]:
    """Returns first and last rows of the stretches of a constant input in which an axis does not move by a count,
    although it speeds up under smaller ones for most of the time in which it does.

    Args:
        times: of the rows [s].
        u: input of the drive, by row.
        position: times [s] and values of the axis.
        resolution: size of its count [m], 0 if it has none.
    """
    cells = in_cells(CELL, times, {"q": position}, {"u": u})
    if cells is None:
        return []
    speed, felt = cells.rate("q"), cells.middle("u")
    way = np.sign(np.dot(speed[cells.whole], felt[cells.whole]))
    faster = cells.whole & (cells.acceleration("q") * speed > 0) & (np.abs(speed) > FAST / 2) & (speed * felt * way > 0)
    if np.count_nonzero(faster) * CELL < HELD:
        return []
    usual = float(np.median(np.abs(felt[faster])))
    x = np.interp(times, *position)
    edges = np.flatnonzero(np.diff(u)) + 1
    found = []
    for start, stop in zip([0, *edges.tolist()], [*edges.tolist(), u.size], strict=True):
        if times[stop - 1] - times[start] < HELD or abs(u[start]) < usual:
            continue
        # What came to rest within the stretch counts from there on.
        moves = np.flatnonzero(np.abs(x[start:stop] - x[stop - 1]) > resolution)
        begin = start + (int(moves[-1]) + 1 if moves.size else 0)
        still = stop - 1
        if begin >= stop - 1 or times[still] - times[begin] < HELD:
            moves = np.flatnonzero(np.abs(x[start:stop] - x[start]) > resolution)
            begin, still = start, start + (int(moves[0]) - 1 if moves.size else stop - 1 - start)
        if times[still] - times[begin] >= HELD:
            found.append((begin, still))
    return found
