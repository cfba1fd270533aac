"""The equation of motion of a driven axis: what its input could do, whatever masses, gains and friction are.

It is `x'' = b u - c x' - d sign(x') + e sin(psi) + f` with `c`, `d` not negative, or, where the drive imposes the
speed, `x' = b u + f`; the input `u` comes at once or late. An input that is read wrongly (turned, in the column of the
position, with a row that the rig never felt) leaves more of the motion than the same input read rightly.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from jbridge.recordings.plausibility.swing_equation import CERTAIN, STRETCH, Cells, Samples, certainly_better, in_cells

LATE, LATE_AGAINST = range(8), range(2)
"""Delays that are tried [cells] of a drive as declared, and of one that is turned. A periodic input, and the limit
cycle of a controller with a late drive, look turned once they come half a period late, so that the declared sign has
every chance, and the other one that of a drive that answers at once."""
CELL = 0.1
"""Time over which a driven axis is averaged [s]: well above sampling periods, not above the time constants of carts."""
FAR, USUAL = 10.0, 0.99
"""Multiple of the size that a share of the rows (`USUAL`) stay below, from which on an input stands out."""
HOLDS = 0.1
"""Share of the mean square, of a motion or of the forces, up to which an equation holds; equations of measured rigs
leave 0.1 to 26 %, and those of exchanged columns 12 to 99 %."""
TINY = 1e-100
"""Size [SI] below which an input is none."""
FOLLOWS = 0.5
"""Share of a motion's mean square below which it follows its input. A sine, or a slow input, could be the
response to what it causes, but then the motion follows it as well."""


@dataclass(frozen=True)
class Response:
    """How well a motion follows an input, at the best delay of each sign."""

    motion: np.ndarray
    """Acceleration or speed by cell of time."""
    along: np.ndarray
    """What is left of it if it goes with the input."""
    against: np.ndarray
    """What is left of it if it goes against the input."""
    gain: float
    """Motion per unit of an input that it goes with."""

    @property
    def left(self) -> np.ndarray:
        """What is left at the better sign."""
        return min(self.along, self.against, key=lambda errors: float(np.sum(errors**2)))


def axis_cells(
    times: np.ndarray, inputs: Mapping[str, np.ndarray], measured: Mapping[str, Samples], psi: Samples | None
) -> Cells | None:
    """Returns an axis in cells of time, or None where the recording is too short to decide anything.

    Args:
        times: of the rows [s].
        inputs: values by row.
        measured: times [s] and values of samples.
        psi: swing angle of the load below, if there is one.
    """
    length = max(CELL, *(2 * float(np.median(np.diff(moments))) for moments, _ in measured.values()))
    load = {} if psi is None else {"sin": (psi[0], np.sin(psi[1]))}
    cells = in_cells(length, times, {**measured, **load}, inputs)
    return cells if cells is not None and np.count_nonzero(cells.whole) >= STRETCH * CERTAIN**2 else None


def responses(cells: Cells, axis: str = "q", u: str = "u") -> tuple[Response, Response]:
    """Returns how the acceleration of an axis, friction and load aside, and how its speed follows an input.

    A friction, and what the load does, may have any sign where it is not known whether the axis is read turned.
    """
    speed = cells.rate(axis)
    direction = np.sign(speed) * (np.abs(speed) > 0.05 * np.abs(speed).max())
    load = [cells.middle("sin")] if "sin" in cells.values else []
    return (
        response(cells, cells.acceleration(axis), u, [-speed, -direction], load),
        response(cells, speed, u, [], []),
    )


def runs_backwards(times: np.ndarray, u: np.ndarray, position: Samples, psi: Samples | None) -> bool:
    """Says whether an axis certainly moves against its input.

    A drive may move with its input or against it, and answer at once or late. Against it is certain if this leaves
    plainly less than the other at every delay, either of the acceleration or of the speed, and if neither speaks for
    the other.
    """
    cells = axis_cells(times, {"u": u}, {"q": position}, psi) if np.ptp(u) > 0 else None
    if cells is None:
        return False
    verdicts = [
        (certainly_better(each.along, each.against), bool(np.sum(each.along**2) < np.sum(each.against**2)))
        for each in responses(cells)
    ]
    return any(against for against, _ in verdicts) and not any(along for _, along in verdicts)


def unfelt_rows(times: np.ndarray, u: np.ndarray, position: Samples, psi: Samples | None) -> np.ndarray:
    """Returns the rows whose input stands far out, if the axis certainly moved as though the row before had lasted.

    A single sample of the input that is large enough leaves its drive no gain at which the rest of the motion follows.
    Behind it the input must be what it was before: the kick of a controller, which a drive may cut off, begins
    something new.
    """
    size = np.abs(u - np.median(u))
    far = size > FAR * np.quantile(size, USUAL)
    if not far.any():
        return np.flatnonzero(far)
    rows = np.arange(u.size)
    before = np.maximum.accumulate(np.where(far, -1, rows))
    after = np.minimum.accumulate(np.where(far, u.size, rows)[::-1])[::-1]
    before, after = np.where(before < 0, after, before), np.where(after == u.size, before, after)
    usual = np.quantile(np.abs(np.diff(u[before])), USUAL)
    far &= np.abs(u[after] - u[before]) <= (after - before) * usual
    held = np.where(far, u[before], u)
    cells = axis_cells(times, {"u": u, "held": held}, {"q": position}, psi) if np.ptp(held) > 0 else None
    if cells is None:
        return np.flatnonzero(False)
    pairs = [(a.left, b.left) for a, b in zip(responses(cells), responses(cells, u="held"), strict=True)]
    unfelt = any(certainly_better(a, b) for a, b in pairs) and not any(certainly_better(b, a) for a, b in pairs)
    return np.flatnonzero(far & unfelt)


def is_input(times: np.ndarray, u: np.ndarray, position: Samples, psi: Samples | None) -> bool:
    """Says whether an axis certainly follows its position as though that were the input, and does not follow its input.

    Both ways are judged by what they leave of their own motion, since their sizes differ.
    """
    if np.ptp(u) == 0 or np.ptp(position[1]) == 0:
        return False
    inputs = {"u": u, "x": np.interp(times, *position)}
    cells = axis_cells(times, inputs, {"q": position, "p": (times, u)}, psi)
    if cells is None:
        return False
    as_read, exchanged = (
        min((each.left / max(float(np.std(each.motion)), 1e-300) for each in responses(cells, axis, name)),
            key=lambda errors: float(np.sum(errors**2)))
        for axis, name in (("q", "u"), ("p", "x"))
    )  # fmt: skip
    holds = float(np.mean(exchanged**2)) < HOLDS and float(np.mean(as_read**2)) > FOLLOWS
    return holds and certainly_better(as_read, exchanged)


def response(cells: Cells, motion: np.ndarray, u: str, positive: list[np.ndarray], free: list[np.ndarray]) -> Response:
    """Returns how a motion follows an input.

    Args:
        cells: of the recording.
        motion: by cell of time.
        u: name of the input.
        positive: what enters with a factor that is not negative.
        free: what enters with any factor.
    """
    chosen = cells.whole
    wanted = motion[chosen]
    others = [part[chosen] for part in (*positive, *free)] + [np.ones(wanted.size)]
    left: dict[bool, np.ndarray] = {}
    gain, values, cell = 0.0, cells.middle(u), np.arange(chosen.size)
    for delay in LATE:
        felt = values[np.maximum(cell - delay, 0)]  # before the first row it is taken to have been as there
        parts = np.stack([felt[chosen], *others], axis=1)
        sizes = np.maximum(np.abs(parts).max(axis=0), TINY)  # no square, and no factor, leaves the range of numbers
        parts /= sizes
        triangle = np.asarray(np.linalg.qr(np.column_stack([parts, wanted]), mode="r"))
        count = parts.shape[1]
        for against in (True, False) if delay in LATE_AGAINST else (False,):
            way = np.ones(count)
            way[0] = -1.0 if against else 1.0
            # What may have any factor enters twice, once with each sign.
            both = triangle[:, :count] * way
            found, _ = nnls(np.column_stack([both, -both[:, count - len(free) - 1 :]]), triangle[:, count])
            factors = found[:count]
            factors[count - len(free) - 1 :] -= found[count:]
            errors = wanted - parts @ (way * factors)
            if against not in left or np.sum(errors**2) < np.sum(left[against] ** 2):
                left[against] = errors
                gain = gain if against or sizes[0] <= TINY else float(factors[0] / sizes[0])
    return Response(wanted, left[False], left[True], gain)
