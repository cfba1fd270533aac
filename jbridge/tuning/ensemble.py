"""Bridges and moves on which a controller must do well: a model's numbers scattered, and moves of several lengths."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._types import Axes
from ..control.base import AbstractController, Reference
from ..model.effects.base import AbstractFriction
from ..model.effects.drives import ActuatorLag, DeadZone, InputDelay
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..model.step_size import substeps
from ..simulation.closed_loop import closed_loop, periods_remembered
from ..simulation.noise import NOISE, Noisy, drawn
from ..simulation.outputs import AbstractCollector, Everything
from ..trajectory import Path, along, durations
from .objectives import Leg

_along = jax.jit(along)


@dataclasses.dataclass(frozen=True)
class Scatter:
    """How far an ensemble's bridges lie from the model, as shares of its own numbers."""

    friction: float = 1 / 3
    """Levels of all dry friction and the damping, axis by axis."""
    load_mass: float = 0.5
    dead_zone: float = 0.3
    lag: float = 0.3
    delay: float = 0.3
    late: float = 0.0
    """Largest further delay of each drive [s], drawn one by one, in an ensemble whose plant was made `late`."""
    least: float = 0.05
    """Least standard deviation of a number whose uncertainty is known, as a share of it: a fit says how well its
    recordings determine a number, and not how far it is another one on another day. At half of it, tuned controllers
    rely on friction that a week changes; at twice of it, a good fit gains little."""
    noise: tuple[float, float, float] = NOISE
    """Standard deviations of the readings of x, psi and l [m, rad, m].
    Without noise nothing keeps a tuned controller from answering each count of an encoder: on a rig of another engine
    the extended rules' cart voltage then travelled 4.5 times as far as before the tuning, in simulations 1.3 times."""


@dataclasses.dataclass(frozen=True)
class Region:
    """Where moves begin and end."""

    rail: tuple[float, float]
    """Lowest and highest place of the cart [m]."""
    rope: tuple[float, float]
    """Shortest and longest rope [m]."""


PAPER_REGION = Region((0.0, 1.2), (0.185, 0.7))
_APART = 0.25
"""Least way of a random move, as a share of the rail."""


@dataclasses.dataclass(frozen=True)
class Legs:
    """Moves from rest to rest."""

    start: NDArray[np.float64]
    """Cart position and rope length [m], `(move, 2)`."""
    goal: NDArray[np.float64]
    speed: tuple[float, float] = (0.3, 0.2)
    """Largest speeds of the reference's cart and rope [m/s]."""
    seconds: float = 10.0
    """Length of every move, the rest at its end included [s]."""

    def __len__(self) -> int:
        """Moves of a bridge."""
        return self.start.shape[-2]

    def of(self, bridges: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Start and goal of every bridge's moves [m], each `(bridge, move, 2)`."""
        shape = (bridges, len(self), 2)
        return np.broadcast_to(self.start, shape), np.broadcast_to(self.goal, shape)


def paper_legs(seconds: float = 10.0) -> Legs:
    """The paper's two moves, `T_z` to `T_1` and `T_1` to `T_2`."""
    points = np.array([[0.0, 0.185], [1.2, 0.6], [0.5, 0.3]])
    return Legs(points[:-1], points[1:], (0.3, 0.2), seconds)


def random_legs(
    count: int,
    seed: int,
    *,
    bridges: int | None = None,
    region: Region = PAPER_REGION,
    seconds: float = 10.0,
    speed: tuple[float, float] = (0.3, 0.2),
) -> Legs:
    """Moves between random places and rope lengths, at least a quarter of the rail apart.

    Args:
        count: moves of a bridge.
        seed: of the draw.
        bridges: how many bridges get moves of their own; None for moves that all of them make.
        region: where to move.
        seconds: length of every move [s].
        speed: largest speeds of the reference's cart and rope [m/s].
    """
    if bridges is not None:
        every = random_legs(count * bridges, seed, region=region, seconds=seconds, speed=speed)
        shape = (bridges, count, 2)
        return Legs(every.start.reshape(shape), every.goal.reshape(shape), speed, seconds)
    rng = np.random.default_rng([seed, 1])  # not the numbers from which bridges are drawn
    starts: list[NDArray[np.float64]] = []
    goals: list[NDArray[np.float64]] = []
    while len(starts) < count:
        a, b = (np.array([rng.uniform(*region.rail), rng.uniform(*region.rope)]) for _ in range(2))
        if abs(a[0] - b[0]) >= _APART * (region.rail[1] - region.rail[0]):
            starts.append(a)
            goals.append(b)
    return Legs(np.array(starts), np.array(goals), speed, seconds)


def mixed_legs(bridges: int, seed: int) -> Legs:
    """Two moves for every bridge: one of the paper's in turn, and a random one of its own.

    With moves that all bridges share, a search fits the controller to their places on the rail.
    """
    own, paper = random_legs(1, seed, bridges=bridges), paper_legs()
    turn = np.arange(bridges) % len(paper)
    start, goal = (
        np.stack([common[turn], mine[:, 0]], axis=1)
        for common, mine in ((paper.start, own.start), (paper.goal, own.goal))
    )
    return Legs(start, goal, paper.speed, paper.seconds)


def late(plant: Plant) -> Plant:
    """The same plant with a delay of 0 in each drive that has none, so that bridges about it may answer late."""
    own = {effect.site for effect in plant.all(InputDelay)}
    more = [InputDelay(delay=jnp.zeros(()), site=site) for site in InputDelay.sites if site not in own]
    return plant.adding(*more)


def scattered(
    plant: Plant,
    count: int,
    seed: int,
    scatter: Scatter = Scatter(),
    uncertainty: Mapping[str, Mapping[str, Any]] | None = None,
) -> NDArray[np.float64]:
    """Parameter vectors of bridges about a plant, the plant itself first.

    Numbers with a known standard deviation are drawn from a normal distribution, cut off at twice that deviation and at
    the parameter's bounds; those of one vector move together. Others scatter by the shares of `scatter`. The load's
    mass always does: loads change, however well one of them is known.

    Args:
        plant: in the middle.
        count: how many, itself included.
        seed: of the draw.
        scatter: how far they lie from it.
        uncertainty: of parameters by name, entries with a `std`, as `Model.uncertainty` has them.

    Returns:
        `(bridge, parameter)`, in the order of the plant's `ParameterTable`.
    """
    table = ParameterTable(plant)
    base = np.array(table.ravel(plant), dtype=float)
    rng = np.random.default_rng(seed)
    factors = np.ones((count, table.size))

    def spread(places: Sequence[int], share: float) -> None:
        # One draw for numbers that belong together, such as the levels of a friction map.
        factors[:, np.asarray(places, int)] = rng.uniform(1.0 - share, 1.0 + share, count)[:, None]

    for name in ("cart_damping", "swing_damping", "hoist_damping"):
        spread(table.positions(name), scatter.friction)
    spread(table.positions("load_mass"), scatter.load_mass)
    for share, family, unit in (
        (scatter.friction, AbstractFriction, "{force}"),
        (scatter.dead_zone, DeadZone, ""),
        (scatter.lag, ActuatorLag, ""),
        (scatter.delay, InputDelay, ""),
    ):
        for owner, effect in enumerate(plant.effects):
            if isinstance(effect, family):
                entries = (table.entry(place) for place in range(table.size))
                own = [place for place, e in enumerate(entries) if e.owner == owner and e.info.unit.startswith(unit)]
                spread([place for place in own if table.entry(place).info.fitted], share)
    draws = np.random.default_rng([seed, 2])  # so that whether a number is known changes no other one
    rows = base * factors
    low, high = table.bounds()
    known = {place.group for place in table.entries}
    for name, interval in sorted((uncertainty or {}).items()):
        # Intervals may be left in a file whose effect was taken out.
        if name == "load_mass" or name not in known or interval.get("std") is None:
            continue
        places = table.positions(name)
        std = np.nan_to_num(np.asarray(interval["std"], float))
        std = np.maximum(std, scatter.least * np.abs(base[places]))
        away = np.clip(draws.standard_normal((count, 1)), -2.0, 2.0) * std
        rows[:, places] = np.clip(base[places] + away, low[places], high[places])
    rows[0] = base
    if scatter.late > 0:
        if len(late(plant).effects) > len(plant.effects):
            raise ValueError("further delays need a plant with an input_delay in each drive")
        for effect in plant.all(InputDelay):
            places = table.positions(f"{effect.kind}@{effect.site}.delay")
            rows[1:, places] += rng.uniform(0.0, scatter.late, (count - 1, 1))
    return rows


class Moves(NamedTuple):
    """Moves as one program takes them, with leading axes of bridges and of their moves."""

    initial: Float[Array, "*move 2"]
    reference: Reference
    leg: Leg


class Course:
    """One plant's structure with moves: runs controllers on many bridges."""

    def __init__(
        self,
        plant: Plant,
        rows: NDArray[np.float64],
        legs: Legs,
        period: float,
        prepare: Callable[[Path], Path] | None = None,
        noise: tuple[float, float, float] = (0.0, 0.0, 0.0),
        active: Axes | None = None,
    ):
        """
        Args:
            plant: structure of all bridges.
            rows: their parameters, `(bridge, parameter)`.
            legs: what the bridges are moved through.
            period: of the controller's sampling [s].
            prepare: what is done to the reference before a controller sees it (`control.shaping.shaped`).
            noise: standard deviations of the readings of x, psi and l [m, rad, m], the same white noise in every move.
            active: 1 for an axis that moves; by default all do.
        """
        self._active = active
        self._prepare = prepare
        self.table = ParameterTable(plant)
        self.rows = rows
        self.legs = legs
        self.period = period
        self.count = math.ceil(legs.seconds / period) + 1
        self._noise = drawn(noise, self.count)
        self._states = plant.states
        self._substeps = substeps(jax.vmap(self.table.unravel)(jnp.asarray(rows)), period)
        # The longest delays, by the slowest clock.
        longest = rows.max(axis=0)
        slow = [p for p in range(rows.shape[1]) if self.table.entry(p).name.startswith("clock_scale")]
        longest[slow] = rows[:, slow].min(axis=0)
        self._memory = periods_remembered(self.table.unravel(jnp.asarray(longest)), period)
        self.moves = self._moves()

    def _moves(self) -> Moves:
        start, goal = (jnp.asarray(ends) for ends in self.legs.of(len(self.rows)))
        speed = jnp.asarray(self.legs.speed)
        arrivals = jax.vmap(jax.vmap(lambda a, b: durations(jnp.stack([a, b]), speed)[0]))(start, goal)
        paths = [[self.path(move, bridge) for move in range(len(self.legs))] for bridge in range(len(self.rows))]
        columns = {
            name: jnp.asarray(np.array([[getattr(path, name) for path in row] for row in paths]))
            for name in ("x", "l", "v_x", "v_l")
        }
        return Moves(start, Reference(**columns), Leg(start, goal, arrivals))

    def path(self, number: int, bridge: int = 0) -> Path:
        """The reference of one move of a bridge, as the controller is given it."""
        times = self.period * np.arange(self.count, dtype=float)
        start, goal = (ends[bridge, number] for ends in self.legs.of(len(self.rows)))
        place, rate = _along(
            jnp.asarray(np.stack([start, goal])), jnp.asarray(self.legs.speed), jnp.asarray(0.0), jnp.asarray(times)
        )
        place, rate = np.asarray(place), np.asarray(rate)
        path = Path(times, place[:, 0], place[:, 1], rate[:, 0], rate[:, 1])
        if self._prepare is None:
            return path
        return Path(*(values[: self.count] for values in self._prepare(path)))

    def run(
        self,
        law: AbstractController,
        row: Float[Array, " parameter"],
        move: Moves,
        *,
        collect: AbstractCollector = Everything(),
        reverse: bool = False,
    ) -> Any:
        """One bridge under a controller through one move (without leading axes); see `closed_loop.closed_loop`."""
        initial = jnp.zeros(self._states, row.dtype).at[0].set(move.initial[0]).at[2].set(move.initial[1])
        return closed_loop(
            self.table.unravel(row),
            law if self._noise is None else Noisy(law, jnp.asarray(self._noise, row.dtype)),
            initial,
            move.reference,
            period=self.period,
            substeps=self._substeps,
            memory=self._memory,
            active=self._active,
            collect=collect,
            reverse=reverse,
        )
