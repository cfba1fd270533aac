"""The load's equation of motion, and how what one reading of a recording leaves of it is compared with another's.

Equations of motion hold whatever a rig's masses, gains and friction are: here that of the load, `l psi'' + 2 l' psi' +
g sin(psi) + x'' cos(psi) = 0`; in `drive` that of a driven axis. Each is met by what was read, and by what would have
been read in another unit or of another sign. What was read is called wrong only if it leaves four times the squared
error (`WORSE`; `OTHER_SCALE` where the scale is no unit's), and if that is no matter of a few moments (`CERTAIN`).
Whatever explains a recording as read, be it badly, stays: noise, friction, rest, a motor that is off, and motion that
both signs explain alike.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from jbridge.recordings.checks import GRAVITY

WORSE = 4.0
"""Squared error that is left, as a multiple of what another reading leaves: twice the rms error."""
CERTAIN = 3.0
"""Sum, over stretches of time, of how plainly each speaks for the other reading, over the root of their sum of
squares. Were each as likely to speak against it, this would be exceeded with a probability of at most exp(-3² / 2) =
1 % (Hoeffding) in each of two ways to weigh them, 0.1 % where many stretches count; the fourfold error comes on top."""
OTHER_SCALE = 40.0
"""The same for a refusal of another scale, where a note takes `WORSE`: a cart that the load alone moves, or a sine,
fits any scale but for friction."""
RIGHT = 1.4
"""Factor up to which the scale of a position or an angle is a matter for a diagnosis, not a slip."""
SCALES = tuple(factor for size in map(float, np.geomspace(RIGHT, 1e3, 80)) for factor in (size, 1.0 / size))
"""Factors that are tried for a scale that is wrong."""
STRETCH = 3
"""Cells of time in a stretch: as many as one second difference spans, so that stretches share little noise."""
Samples = tuple[np.ndarray, np.ndarray]
"""Times [s] and values of a channel's samples."""


@dataclass(frozen=True)
class Cells:
    """Channels of a recording as means over equal cells of time, which no noise of single samples shows in."""

    length: float
    """Of a cell [s]."""
    whole: np.ndarray
    """True where a cell, and the two after it, hold no gap."""
    values: Mapping[str, np.ndarray]
    """Mean of each channel by cell."""
    inputs: frozenset[str] = frozenset()
    """Channels that change in steps."""

    def middle(self, name: str) -> np.ndarray:
        """Returns a channel as seen by the kernel of the second difference, which is a triangle over running means:
        exact where these are cubic, as Numerov weights them, or for an input that is constant in each cell."""
        v, centre = self.values[name], 4 if name in self.inputs else 10
        return (v[:-2] + centre * v[1:-1] + v[2:]) / (centre + 2)

    def rate(self, name: str) -> np.ndarray:
        """Returns the first derivative, by central differences."""
        v = self.values[name]
        return (v[2:] - v[:-2]) / (2 * self.length)

    def acceleration(self, name: str) -> np.ndarray:
        """Returns the second derivative, exact for the mean under the kernel."""
        v = self.values[name]
        return (v[2:] - 2 * v[1:-1] + v[:-2]) / self.length**2


def rope(times: np.ndarray, samples: Mapping[str, Samples], locked_length: float | None) -> Samples | None:
    """Returns the samples of the rope's length [m], the same at both ends of the times [s] where it is locked."""
    constant = None if locked_length is None else (times[[0, -1]], np.full(2, locked_length))
    return samples.get("l", constant)


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
    return Cells(length, whole, values, frozenset(inputs))


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


@dataclass(frozen=True)
class Misread:
    """How cart and angle would have to be read for the load's equation to hold."""

    factor: float = 1.0
    """By which the cart's position is too small, where its unit is not the declared one."""
    turned: bool = False
    """Whether the angle, or the position, has the other sign."""


@dataclass(frozen=True)
class SwingTerms:
    """Terms of the load's equation by cell [m/s²]."""

    turning: np.ndarray
    """`l psi'' + 2 l' psi'`, without its mean."""
    weight: np.ndarray
    """`g sin(psi)`, without its mean."""
    carried: np.ndarray
    """`x'' cos(psi)`, without its mean."""
    cart: np.ndarray
    """`x''`"""
    angle: np.ndarray
    """`psi` [rad]."""

    def errors(self, factor: float) -> np.ndarray:
        """Returns what the equation leaves [m/s²], if the cart's position is `factor` times what was read, or the angle
        is what was read over `factor`: large angles tell the two apart.

        -1 stands for another sign of either the position or the angle, which the equation cannot tell apart, and 0 for
        a cart that does not matter. The rope may be up to twice as long or short as declared, and the angle's zero, if
        not its scale, anywhere near hanging or near upright.
        """
        forces = [self.force(factor)]
        if factor == 0.0:
            # Where the angle is noise, a smaller scale of all forces leaves less, and no force at all the least.
            forces.append(np.zeros_like(self.weight))
        # Only where the load then swings through less than half a turn, as one on a rope does.
        if abs(factor) not in (0.0, 1.0) and np.ptp(self.angle) < np.pi * abs(factor):
            forces.append(self.over(factor))
        left = [self.about(way, force) for force in forces for way in (1.0, -1.0)]
        return min(left, key=lambda each: float(np.sum(each * each)))

    def left(self, factor: float) -> float:
        """Returns the sum of squares of these errors."""
        return float(np.sum(self.errors(factor) ** 2))

    def force(self, factor: float = 1.0) -> np.ndarray:
        """Returns weight and inertia where the position is `factor` times what was read."""
        return self.weight + factor * self.carried

    def over(self, factor: float) -> np.ndarray:
        """Returns the same, `factor` times as large, where the angle is what was read over `factor`."""
        angle = self.angle / factor
        return factor * without_mean(GRAVITY * np.sin(angle) + self.cart * np.cos(angle))

    def about(self, way: float, force: np.ndarray) -> np.ndarray:
        """Returns what is left where the angle's zero is near hanging (`way` 1), or near upright (-1)."""
        return np.clip(way * self.share(force), 0.5, 2.0) * self.turning + way * force

    def share(self, force: np.ndarray) -> float:
        """Returns the rope's length over the one read with which the equation leaves least."""
        return -float(np.sum(self.turning * force) / max(float(np.sum(self.turning * self.turning)), 1e-300))


def without_mean(values: np.ndarray) -> np.ndarray:
    """Returns values whose mean is 0."""
    return values - values.mean()


def swing_terms(cells: Cells) -> SwingTerms:
    """Returns the terms of the load's equation."""
    psi, l = cells.middle("psi"), cells.middle("l")
    turning = l * cells.acceleration("psi")
    if np.ptp(l) > 0:
        turning = turning + 2 * cells.rate("l") * cells.rate("psi")
    weight, cart = GRAVITY * cells.middle("sin"), cells.acceleration("x")
    turned, hung, carried = (without_mean(part[cells.whole]) for part in (turning, weight, cart * np.cos(psi)))
    return SwingTerms(turned, hung, carried, cart[cells.whole], psi[cells.whole])


def misread_swing(
    times: np.ndarray, psi: Samples, x: Samples | None, l: Samples, units: Collection[float] = (0.01, 0.001)
) -> Misread | None:
    """Returns how cart and angle would have to be read for the load's equation to hold, if that is certain.

    Each channel comes as times [s] and values of its samples; `x` is None for a fixed cart. What may be right as it
    was read gives None. `units` are factors by which a position in another unit would be too small.
    """
    if x is None:
        return None
    cells = swing_cells(times, psi, x, l)
    if cells is None:
        return None
    terms = swing_terms(cells)

    unit, scale = (best_scale(terms, sizes) for sizes in ([1.0, *units], SCALES))
    plainer = certainly_better(terms.errors(unit), terms.errors(scale), worse=OTHER_SCALE)
    if asks_for(terms, unit, WORSE) and not plainer:
        return Misread(abs(unit), unit < 0)
    size = other_scale(terms, OTHER_SCALE, scale)
    if size is None:
        return None
    # Where another sign alone mends it nearly as well, the scale is a matter for a diagnosis.
    turned = size < 0 and not certainly_better(terms.errors(-1.0), terms.errors(size))
    return Misread(1.0 if turned else abs(size), size < 0)


def best_scale(terms: SwingTerms, sizes: Collection[float] = SCALES) -> float:
    """Returns the factor among these, or the one against the sign as read, with which the equation leaves least."""
    return min((way * size for size in sizes for way in (1.0, -1.0)), key=terms.left)


def asks_for(terms: SwingTerms, factor: float, worse: float) -> bool:
    """Says whether the equation certainly asks for another scale by a factor, see `SwingTerms.errors`.

    The cart must be needed at all: a position that is mere noise is best left out.
    """
    errors = terms.errors(factor)
    needed = certainly_better(terms.errors(0.0), errors, worse=worse / 2)
    return needed and certainly_better(terms.errors(1.0), errors, worse=worse)


def other_scale(terms: SwingTerms, worse: float, near: float) -> float | None:
    """Returns by which factor the cart's position is too small, or the angle too large, if that is certain; it is
    negative where the sign is wrong as well.

    Args:
        terms: of the load's equation.
        worse: squared error that it leaves as read, as a multiple of what it leaves with that factor.
        near: about the factor, as `best_scale` gives it.
    """
    if not asks_for(terms, near, worse):
        return None
    way, size = 1.0 if near > 0 else -1.0, abs(near)
    size = float(minimize_scalar(lambda size: terms.left(way * size), bounds=(0.9 * size, 1.1 * size)).x)
    return way * size if max(size, 1.0 / size) >= RIGHT else None


def falls_away(cells: Cells, way: float = 1.0) -> bool:
    """Says whether the load certainly moves as about an angle whose zero is upright, and not as hanging there.

    Args:
        cells: of the swing.
        way: 1, or -1 where the angle has the other sign than it was read with.
    """
    terms = swing_terms(cells)
    force = terms.force(way)
    return certainly_better(terms.about(1.0, force), terms.about(-1.0, force))


def likelier_sign(cells: Cells) -> float:
    """Returns the sign, 1 or -1, of an angle whose zero is upright with which the load's equation leaves less."""
    terms = swing_terms(cells)
    return min((1.0, -1.0), key=lambda way: float(np.sum(terms.about(-1.0, terms.force(way)) ** 2)))


def hanging(cells: Cells, *, upright: bool = False, way: float = 1.0) -> float:
    """Returns the angle at which a load hangs in the mean [rad]: what its equation of motion leaves, over gravity.

    Args:
        cells: of the swing.
        upright: whether the angle's zero is near upright.
        way: 1, or -1 where the angle has the other sign than it was read with.
    """
    turn = cells.middle("l") * cells.acceleration("psi") + 2 * cells.rate("l") * cells.rate("psi")
    pull = GRAVITY * cells.middle("sin") + way * cells.acceleration("x") * np.cos(cells.middle("psi"))
    force = turn - pull if upright else turn + pull
    angle = float(np.arcsin(np.clip(np.mean(force[cells.whole]) / GRAVITY, -1.0, 1.0)))
    return angle + float(np.copysign(np.pi, np.mean(cells.values["psi"]))) if upright else angle


def swing_cells(times: np.ndarray, psi: Samples, x: Samples, l: Samples, share: float = 1.0) -> Cells | None:
    """Returns a swing in eighths of its period, or None where it is too short to decide anything.

    The period is that on a rope of a `share` of the length that was read.
    """
    period = 2 * np.pi * np.sqrt(share * float(np.median(l[1])) / GRAVITY)
    cells = in_cells(period / 8, times, {"x": x, "psi": psi, "l": l, "sin": (psi[0], np.sin(psi[1]))}, {})
    return cells if cells is not None and np.count_nonzero(cells.whole) >= STRETCH * CERTAIN**2 else None
