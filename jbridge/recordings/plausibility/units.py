"""Columns that are plainly in another unit than declared.

Sizes show a unit: no laboratory's rail is 20 m long. What sizes leave open shows in the load's equation of motion.
"""

from collections.abc import Iterator

import numpy as np

from jbridge.errors import InputError, cut
from jbridge.recordings.channels import Channels
from jbridge.recordings.checks import FASTEST, LONGEST, SLOWEST, TOO_FAST, as_of_log, excess_of_angle
from jbridge.recordings.plausibility.drive_equation import CELL
from jbridge.recordings.plausibility.lengths import swung_share
from jbridge.recordings.plausibility.refusals import FORCE, refusal
from jbridge.recordings.plausibility.swing_equation import (
    WORSE,
    SwingTerms,
    best_scale,
    certainly_better,
    other_scale,
    swing_cells,
    swing_terms,
)
from jbridge.recordings.tables.columns import UNITS, labelled_columns

SMALLEST = 1e-3
"""Way of a driven cart [m] below which a header's unit is doubted."""
HALF, SLIP = 0.5, 0.01
"""Share of a position's range through which no cart moves from one row to the next, and shortest time [s] that is
counted for that, so that noise between close rows is no motion."""
LEAP = 10.0
"""Multiple of what steps from row to row usually differ by (of which 1 % exceed it) that no motion adds to one."""
LEFT_OUT = 6
"""Largest changes from step to step that do not count for what is usual: two wrong rows have as many."""
GON = (np.pi / 200, "gon (400 to a turn)")
"""Size of a unit of angles that is told from degrees only where that is certain, and what it is called."""
LEAST = {"x": (0.02, 200.0), "l": (0.02, 200.0), "psi": (0.05, 1000.0)}
"""Step [m, rad], beyond those of the rows around, that is more than a few counts that a sensor missed, and acceleration
[m/s², rad/s²] that no rig reaches."""


def doubtful_units(channels: Channels) -> Iterator[InputError]:
    """Yields the refusals of times, positions and lengths that are too large or small for seconds and metres."""
    times = channels.values["t"]
    step = float(np.median(np.diff(times)))
    if step > SLOWEST:
        yield refusal_of_steps(channels, f"a row every {step:.4g} s is too slow for a swing", step)
        return
    if step < FASTEST:
        what = f"a row every {step:.3g} s is more often than any log of a rig"
        yield refusal_of_steps(channels, what, step)
        return
    jumps = list(doubtful_jumps(channels))
    if jumps:
        yield from jumps
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
            factor = 1e-2 if size < 200 else 1e-3 if size < 20_000 else 1e-6
            if channels.columns[name].scale is None and channels.columns[name].unit == "m":
                what += f" ({1e-2 * size:.2g} m if it is in cm, {1e-3 * size:.2g} m in mm)"
            yield refusal(channels, name, what, factor=factor)
        elif name == "x" and 0 < size < SMALLEST:
            yield from doubtful_rest(channels, size)


def refusal_of_steps(channels: Channels, what: str, step: float) -> InputError:
    """Returns the refusal of times that are too close or too far apart [s], with the unit that mends it."""
    column = channels.columns["t"]
    mended = as_of_log(column, step)
    remedy = "give the time in s" if mended is None else f"declare {mended.line('t')} under {channels.place('t')}"
    return InputError(f"{channels.table.path}, column {cut(column.name)}: {what}; {remedy}{FORCE}")


def doubtful_rest(channels: Channels, way: float) -> Iterator[InputError]:
    """Yields the refusal of a driven cart that hardly moves [m], if a larger unit than the header's makes it do so."""
    column = channels.columns["x"]
    u = channels.values.get("u_x")
    if u is None or np.ptp(u) == 0 or column not in labelled_columns("x", [column.name]):
        return
    size = UNITS["x"][column.unit]
    factor = max(other / size for other in UNITS["x"].values() if way * other / size <= LONGEST / 10)
    if factor > 1:
        yield refusal(channels, "x", f"{1e3 * way:.2g} mm are no way for a cart that is driven", factor=factor)


def doubtful_jumps(channels: Channels) -> Iterator[InputError]:
    """Yields the refusals of positions and lengths that leap through half their range from one row to the next."""
    times = channels.values["t"]
    for name in ("x", "l"):
        values = channels.values.get(name)
        if values is None:
            continue
        steps = np.abs(np.diff(values))
        leaps = steps > np.maximum(HALF * np.ptp(values), LONGEST * np.maximum(np.diff(times), SLIP))
        if leaps.any():
            sample = int(leaps.argmax()) + 1
            other = "u_x" if name == "x" else "u_l"
            yield channels.error(
                sample,
                name,
                f"{steps[sample - 1]:.3g} m away from the row above, {1e3 * (times[sample] - times[sample - 1]):.3g} ms"
                f" before, faster than any motion; correct or delete the row, or declare another column for {name} if"
                f" this is an input such as {other}{FORCE}",
            )


def leaping(times: np.ndarray, values: np.ndarray, least: float, fastest: float) -> np.ndarray:
    """Returns, for each step from row to row, whether it is much larger than those around, and as nothing accelerates.

    Args:
        times: of the rows [s].
        values: of a channel.
        least: step that may be one.
        fastest: acceleration that a rig may reach.
    """
    steps, apart = np.diff(values), np.diff(times)
    padded = np.pad(np.abs(steps), 3, mode="reflect") if steps.size > 3 else np.pad(np.abs(steps), 3)
    around = [padded[3 + k : 3 + k + steps.size] for k in (-3, -2, -1, 1, 2, 3)]
    further = np.abs(steps) - np.median(around, axis=0)
    # Bends of the leaps themselves, a few, are no yardstick.
    bends = np.sort(np.abs(np.diff(steps)))[:-LEFT_OUT]
    usual = float(np.quantile(bends[bends > 0], 0.99)) if (bends > 0).any() else 0.0
    return further > np.maximum(max(LEAP * usual, least), fastest * apart**2)


def doubtful_angle(channels: Channels, locked_length: float | None) -> Iterator[InputError]:
    """Yields the refusal of an angle that accelerates as no load does: one in degrees, milliradians, gon or counts."""
    values = channels.values
    length = values.get("l", locked_length)
    if "psi" not in values or length is None or ("l" not in values and length > LONGEST):
        return
    excess = excess_of_angle(values["t"], values["psi"], values.get("x"), np.broadcast_to(length, values["t"].shape))
    if excess > TOO_FAST:
        times, x = values["t"], values.get("x", np.zeros(values["t"].size))
        l = times, np.array(np.broadcast_to(length, times.shape))
        share = swung_share(times, (times, values["psi"]), (times, x), l, holding=True)
        if share is not None and share * excess <= TOO_FAST:
            return  # the length is at fault, which a note says
        far = float(np.abs(values["psi"] - np.median(values["psi"])).max())
        size, called = size_of_angle(values["t"], values["psi"], values.get("x"), length, excess)
        what = f"a swing of {far:.4g} rad, {excess:.0f} times as fast as gravity and the cart can make it"
        counts = size not in UNITS["psi"].values()
        yield refusal(channels, "psi", f"{what}, is in {called}", factor=size, counts=counts)


def size_of_angle(
    times: np.ndarray, psi: np.ndarray, x: np.ndarray | None, length: np.ndarray | float, excess: float
) -> tuple[float, str]:
    """Returns the size [rad] of an angle's unit in which the load's equation holds best, and what it is called.

    Where a recording is too short for that, the excess decides: degrees read as radians turn 180 / pi times too fast
    at most, for a length wrong by two twice that. In degrees or milliradians, cart and load must agree; where they do
    not, the angle is in counts of the size at which they do, unless the load then turns over.
    """
    deg, mrad = ((UNITS["psi"][unit], called) for unit, called in (("deg", "degrees"), ("mrad", "milliradians")))
    if np.ptp(psi) < 1.01 * 360 and np.abs(np.diff(psi)).max() > 0.9 * 360:
        return deg  # the sensor starts again at each turn
    l = times, np.array(np.broadcast_to(length, times.shape))
    position = times, np.zeros_like(times) if x is None else x

    def read(size: float) -> tuple[SwingTerms, np.ndarray] | None:
        """The terms of the load's equation, and what it leaves of them at the better sign."""
        cells = swing_cells(times, (times, np.unwrap(size * psi)), position, l)
        if cells is None:
            return None
        terms = swing_terms(cells)
        errors = min((terms.errors(way) for way in (1.0, -1.0)), key=lambda each: float(np.sum(each**2)))
        return terms, errors / np.sqrt(max(float(np.var(terms.turning) + np.var(terms.weight)), 1e-300))

    by_excess = deg if excess < TOO_FAST * 180 / np.pi else mrad
    found = {each: read(each[0]) for each in (deg, mrad, GON)}
    left = {each: 0.0 if one is None else float(np.mean(one[1] ** 2)) for each, one in found.items()}
    best = by_excess
    if 1.1 * min(left[deg], left[mrad]) < max(left[deg], left[mrad]):
        best = min((deg, mrad), key=lambda each: left[each])
    as_read, in_gon = found[best], found[GON]
    if x is None or as_read is None or in_gon is None:
        return best
    if certainly_better(as_read[1], in_gon[1]):
        return GON
    factor = other_scale(as_read[0], WORSE, best_scale(as_read[0]))
    size = best[0] / abs(factor or 1.0)
    if factor is None or size * np.ptp(psi) > 2 * np.pi:
        return best
    return size, f"counts of about {size:.3g} rad, as the way of its cart shows (2 pi over the counts of a turn)"
