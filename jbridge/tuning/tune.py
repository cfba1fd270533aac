"""`tune`: a controller made better by gradients through simulated moves on many bridges at once."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from .._display import Displayed
from .._progress import Step, silent, with_progress
from ..control.files import Controller
from ..errors import InputError
from ..model.files import Model, check_lengths, requires
from ..simulation.closed_loop import Response
from ..simulation.tracking import check_limits, moving
from ..trajectory import Path
from .cost import Cost, Measure
from .ensemble import PAPER_REGION, Course, Legs, Region, Scatter, late, mixed_legs, random_legs, scattered
from .objectives import Goal, usual_goal
from .tunable_parameters import AbstractKnobs, knobs_of

SOFT, HARD = 0.3, 0.03
"""Softness at the beginning and at the end."""
MOST = 10**5
"""Most bridges, steps and starts: what takes days, or more memory than there is, is a slip."""
_HARDENED = 0.6
"""Share of the steps after which the softness has reached its end."""
_RATE = 0.15
"""Step length at the beginning, in logarithms of the controller's numbers."""
_LOUDEST = 3.0
"""Largest gradient of a rollout that counts in full, over the median."""
_DRAWS = 16
"""Random controllers of which the best one is a start."""
_TRIAL = 5
"""Share of the steps, one in so many, after which only the best start goes on."""
_JUDGED = 10
"""How often on its way a start is judged with the textbook's inference."""
_LOST = 1.1
"""Smooth cost, over that of the best place so far, from which a descent goes back there."""
_HELD_OUT_MOVES = 4


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Tuning(Displayed):
    """A tuned controller and how it compares."""

    controller: Controller
    """Tuned; with the textbook's inference."""
    given: Controller
    coordinates: Mapping[str, float]
    """How far each number was moved, as a logarithm (0: not at all)."""
    history: NDArray[np.float64]
    """Smooth cost before each step of the start that went on to the end."""
    softness: NDArray[np.float64]
    """Softness of each step."""
    costs: Mapping[str, tuple[float, float]]
    """Cost with the textbook's inference, before and after: `train` and `held_out`."""
    measures: Mapping[str, tuple[Mapping[str, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]]]
    """The same by name, `(bridge, move)`, before and after, units as in `move_summary.UNITS`."""
    responses: tuple[Mapping[str, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]]
    """First move of the model itself, before and after: `t` [s], `x`, `psi`, `l` [m, rad, m], `u_x`, `u_l` [V], and the
    reference's `x_ref`, `l_ref` [m]."""
    reached: Mapping[str, tuple[float, float]]
    """Least and largest place of the cart (`x` [m]) and rope length (`l` [m]) at which a move begins or ends."""
    recorded: Mapping[str, tuple[float, float]]
    """The same in the model's recordings; see `Model.recorded`."""
    units: Mapping[str, str]
    """Unit of each input where it is not volts; see `Model.units`."""
    rollouts: int
    """Simulated moves, gradients counted once."""
    seconds: float


@with_progress
def tune(  # noqa: PLR0913
    model: Model,
    controller: Controller,
    *,
    goal: Goal | None = None,
    legs: Legs | None = None,
    region: Region | None = None,
    prepare: Callable[[Path], Path] | None = None,
    plants: int = 64,
    held_out: int = 64,
    steps: int = 200,
    starts: int = 3,
    scatter: Scatter = Scatter(),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Tuning:
    """Moves a controller's numbers so that it does well on many bridges about a model.

    Args:
        model: in the middle of the ensemble; the cart and the load alone where the rope is locked (`Model.has_hoist`).
        controller: what is tuned: a fuzzy controller's sets, scales and rule weights, or another law's gains.
        goal: what is to be small; `objectives.usual_goal` by default.
        legs: moves to learn from; by default two for every bridge, one of the paper's and one of its own, or two of
            its own if there is a region.
        region: where random moves begin and end, held-out ones among them; by default where the paper's do. Both ends
            of a locked rope are its length.
        prepare: what is done to a reference before a controller sees it; by default its own shaping.
        plants: bridges to learn from, the model itself among them.
        held_out: further bridges, on which random other moves are made; they choose nothing.
        steps: gradient steps.
        starts: number of starts, the given controller first, then the best of some random ones about it, every second
            start with random scales or gains alone; after a fifth of the steps only the best goes on.
        scatter: how far bridges lie from the model where it does not say how certain it is; see `scattered`.
        seed: of bridges, moves and starts.
        progress: told what goes on, a short text at a time; by default a bar on a terminal or in a notebook.

    Raises:
        InputError: the model lacks a part of the bridge, a drive's limit lies within its dead zone, or moves change the
            length of a rope that is locked.
        TypeError: the controller has nothing that can be tuned.
    """
    begun = time.perf_counter()
    tell = progress or silent
    requires(model, model.axes)
    check_lengths(model)
    check_limits(model, controller)
    for name, number in {"plants": plants, "held_out": held_out, "steps": steps, "starts": starts}.items():
        if not 1 <= number <= MOST:
            raise InputError(f"{name} {number}: give at least 1 and at most {MOST}")
    if seed < 0:
        raise InputError(f"seed {seed}: give 0 or more")
    if legs is None:
        legs = mixed_legs(plants, seed) if region is None else random_legs(2, seed, bridges=plants, region=region)
    ropes = {*np.ravel([legs.start[..., 1], legs.goal[..., 1]]).tolist(), *(region or PAPER_REGION).rope}
    if not model.has_hoist and len(ropes) > 1:
        raise InputError(
            f"{model.source or 'the model'}: no winch_mass and no hoist_gain, so that the rope is locked; give its "
            "length as both ends of the rope's region, as in --rope 0.42 0.42"
        )
    knobs = knobs_of(controller.law)
    period, prepare = controller.period, prepare or controller.shaping
    plant = late(model.plant) if scatter.late > 0 else model.plant
    # No sensor reads a rope that is locked.
    noise = scatter.noise if model.has_hoist else (*scatter.noise[:2], 0.0)
    course = Course(
        plant, scattered(plant, plants, seed, scatter, model.uncertainty), legs, period, prepare, noise, moving(model)
    )
    others = Course(
        plant,
        scattered(plant, held_out + 1, seed + 1, scatter, model.uncertainty)[1:],
        random_legs(
            _HELD_OUT_MOVES,
            seed + 1,
            bridges=held_out,
            region=region or PAPER_REGION,
            seconds=legs.seconds,
            speed=legs.speed,
        ),
        period,
        prepare,
        noise,
        moving(model),
    )
    cost = Cost(course, goal or usual_goal(), knobs)
    far = Cost(others, goal or usual_goal(), knobs)
    z, history, softness, rollouts = descend(cost, knobs, steps, starts, seed, tell)
    tell("measuring on other bridges and moves")
    none = np.zeros_like(z)
    costs = {"train": (cost.hard(none), cost.hard(z)), "held_out": (far.hard(none), far.hard(z))}
    tuned = knobs.set(jnp.asarray(z))
    given = knobs.set(jnp.asarray(none))
    judges = {"train": Measure(course), "held_out": Measure(others)}
    measures = {name: (judge(given), judge(tuned)) for name, judge in judges.items()}
    run, first = jax.jit(course.run), jax.tree.map(lambda leaf: leaf[0, 0], course.moves)
    before, after = (_columns(run(law, jnp.asarray(course.rows[0]), first)) for law in (given, tuned))
    return Tuning(
        controller=dataclasses.replace(controller, law=tuned),
        given=controller,
        coordinates={knob.name: float(value) for knob, value in zip(knobs.knobs, z, strict=True)},
        history=history,
        softness=softness,
        costs=costs,
        measures=measures,
        responses=(before, after),
        reached=_reached(legs, others.legs),
        recorded=model.recorded,
        units=model.units,
        rollouts=rollouts,
        seconds=time.perf_counter() - begun,
    )


def _reached(*several: Legs) -> dict[str, tuple[float, float]]:
    ends = np.concatenate([end.reshape(-1, 2) for legs in several for end in (legs.start, legs.goal)])
    low, high = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
    return {"x": (low[0], high[0]), "l": (low[1], high[1])}


def _columns(run: Response) -> Mapping[str, NDArray[np.float64]]:
    columns = {"t": run.times, "x": run.q.x, "psi": run.q.psi, "l": run.q.l}
    columns |= {"u_x": run.command[:, 0], "u_l": run.command[:, 1], "x_ref": run.reference.x, "l_ref": run.reference.l}
    return {name: np.asarray(values) for name, values in columns.items()}


def common_slope(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the rollouts' gradients `(rollout, knob)`, none of which may count for more than a few others.

    Where a loop chatters between sticking and sliding, a gradient grows from sample to sample, by many orders of
    magnitude in the end, and says nothing any more; that of most other rollouts still does.
    """
    sound = np.isfinite(slopes).all(axis=1)
    if not sound.any():
        return np.zeros(slopes.shape[1])
    kept = slopes[sound]
    sizes = np.linalg.norm(kept, axis=1)
    most = _LOUDEST * np.median(sizes)
    return np.sum(kept * np.minimum(1.0, most / np.maximum(sizes, 1e-300))[:, None], axis=0) / len(slopes)


class _State(NamedTuple):
    """Where a descent stands, beside its place."""

    moments: optax.OptState
    best: NDArray[np.float64]
    """The best place that was compared on the way."""
    share: float = 1.0
    """Of the schedule's pace."""


def descend(
    cost: Cost, knobs: AbstractKnobs, steps: int, starts: int, seed: int, tell: Callable[[str], None]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]:
    """Adam with a softness that shrinks; the best start, judged with the textbook's inference, goes to the end."""
    low, high = knobs.bounds()
    rng = np.random.default_rng(seed)
    softness = np.geomspace(SOFT, HARD, max(1, round(_HARDENED * steps)))
    softness = np.append(softness, np.full(steps - len(softness), HARD))
    schedule = optax.cosine_decay_schedule(_RATE, steps, alpha=0.05)
    adam = optax.chain(optax.clip_by_global_norm(1.0), optax.scale_by_adam())
    trial = max(1, steps // _TRIAL) if starts > 1 else steps
    rollouts, every = 0, max(1, steps // _JUDGED)
    taken, all_steps = 0, starts * trial + steps - trial
    found: list[tuple[float, NDArray[np.float64]]] = []

    def judge(z: NDArray[np.float64]) -> float:
        """The cost with the textbook's inference, which alone decides what is kept."""
        nonlocal rollouts
        value = cost.hard(z)
        rollouts += cost.count
        found.append((value if np.isfinite(value) else np.inf, z))
        return found[-1][0]

    def go(z: NDArray[np.float64], state: _State, first: int, last: int, which: str) -> Any:
        nonlocal rollouts, taken
        course = []
        for step in range(first, last):
            values, slopes = cost.gradients(z, float(softness[step]))
            rollouts += cost.count
            taken += 1
            course.append(float(np.mean(values)))
            if step % 10 == 0:
                tell(Step(f"step {step} of {steps}{which}: cost {course[-1]:.3g}", done=taken / all_steps))
            if step % every == every - 1 and step > first:
                before = cost.smooth(state.best, float(softness[step]))
                rollouts += cost.count
                if course[-1] < before or not np.isfinite(before):
                    state = state._replace(best=z)
                elif not course[-1] <= _LOST * before:
                    tell(f"step {step} of {steps}{which}: back to the best controller so far, at half the pace")
                    # Slope and moments are of the way that led astray.
                    z, state = state.best, _State(adam.init(jnp.asarray(z)), state.best, 0.5 * state.share)
                    continue
            update, moments = adam.update(jnp.asarray(common_slope(slopes)), state.moments)
            z = np.clip(z - state.share * float(schedule(step)) * np.asarray(update), low, high)
            state = state._replace(moments=moments)
            if step % every == every - 1:
                judge(z)
        return z, state, course

    judge(np.zeros(len(low)))
    begins = [np.zeros(len(low))]
    spread = np.array([knob.spread for knob in knobs.knobs])
    coarse = np.array([knob.is_coarse for knob in knobs.knobs])
    for number in range(starts - 1):
        tell(f"drawing start {number + 2} of {starts}")
        # What is guessed by orders of magnitude first by itself: among many numbers a good one is rarely drawn.
        moved = spread * coarse if number % 2 == 0 and coarse.any() else spread
        draws = [np.clip(moved * rng.standard_normal(len(low)), low, high) for _ in range(_DRAWS)]
        begins.append(min(draws, key=judge))
    runs = []
    for number, begin in enumerate(begins):
        which = f", start {number + 1} of {starts}" if starts > 1 else ""
        z, state, course = go(begin, _State(adam.init(jnp.asarray(begin)), begin), 0, trial, which)
        runs.append((judge(z), z, state, course))
    _, z, state, course = min(runs, key=lambda run: run[0])
    z, _, rest = go(z, state, trial, steps, "")
    judge(z)
    best = min(found, key=lambda entry: entry[0])[1]
    return best, np.array(course + rest), softness, rollouts
