"""How long an integration step of a plant may be."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Array

from .effects.base import DRIVE_OF_AXIS
from .effects.flexible import BeltCompliance, DoublePendulum, HoistBacklash, RopeElasticity
from .effects.motors import AbstractInduced
from .plant import Plant

RIGID = 0.0051
"""Longest step of a rigid bridge [s]: 5 ms by a clock that is a little slow."""
_TURN = 0.42
"""Angle [rad] by which hidden masses may go on ringing in one step."""
_FADE = 1.0
"""Share of its velocity that viscous damping may take from a mass in one step, judged at the step's beginning."""
_DECIDED, _STABLE = 3, 8
"""How often a step is halved at most: for a belt or a hidden spring, decided in closed form within a step, where a
longer one only blurs what acts beside them; and for what would grow from step to step otherwise."""


def longest_step(plant: Plant, rigid: float, damped: Sequence[str] = ()) -> float:
    """The longest integration step [s] for a plant, `rigid` divided by a power of two, since each step is a program.

    Args:
        plant: known numbers; with leading axes where it stands for many bridges.
        rigid: the longest step of a rigid bridge [s]; hidden masses take half of it at most.
        damped: see `equations.accelerations`.
    """
    decided, explicit = (max(own, default=0.0) for own in paces(plant, damped))
    hidden = plant.mechanisms or plant.hysteresis is not None
    halvings = max(
        1 if hidden else 0,
        min(_halvings(rigid * decided), _DECIDED),
        min(_halvings(rigid * explicit), _STABLE),
    )
    return rigid / 2**halvings


def substeps(plant: Plant, period: float, rigid: float = RIGID, damped: Sequence[str] = ()) -> int:
    """Integration steps in each `period` [s], see `longest_step`."""
    return max(1, math.ceil(period / longest_step(plant, rigid, damped) - 1e-6))


def _halvings(pace: float) -> int:
    return math.ceil(math.log2(pace)) if pace > 1.0 else 0


def allows_order_4(plant: Plant, damped: Sequence[str]) -> bool:
    """Whether steps may be of order 4, whose stages extrapolate: beside a damping in closed form that makes contact
    behind a belt or a play unstable.

    Args:
        plant: known numbers.
        damped: see `stiff_axes`.
    """
    return not damped or not any(_parted(plant).values())


def stiff_axes(plant: Plant) -> tuple[str, ...]:
    """Axes whose viscous damping is better solved in closed form (see `equations.accelerations`), since steps may be
    longer then."""
    parted = _parted(plant)
    rates, whole = _fading(plant, ()), not any(parted.values())
    axes = tuple(
        axis
        for axis in DRIVE_OF_AXIS
        if (parted[axis] or whole) and plant.speed_loop(axis) is None and rates[axis] * RIGID > _FADE
    )
    return axes if longest_step(plant, RIGID, axes) > longest_step(plant, RIGID) else ()


def _parted(plant: Plant) -> dict[str, bool]:
    """Whether something parts a drive from its axis."""
    return {"x": plant.drive_train is not None, "l": plant.rope_end is not None}


def _fading(plant: Plant, damped: Sequence[str]) -> dict[str, float]:
    """Share of its velocity that a drive's damping takes from it per second, by axis."""
    b, train, play = plant.bridge, plant.drive_train, plant.only(HoistBacklash)
    winch = b.winch_mass if plant.only(RopeElasticity) is not None else b.winch_mass + b.load_mass
    masses = {
        "x": b.cart_mass if train is None else train.motor_mass,
        "l": winch if play is None else play.motor_mass,
    }
    whole, found = not any(_parted(plant).values()), {}
    for axis, damping, gain in (("x", b.cart_damping, b.cart_gain), ("l", b.hoist_damping, b.hoist_gain)):
        loop = plant.speed_loop(axis)
        # A speed loop is solved in closed form, unless something parts a drive from its axis.
        left = 0.0 if axis in damped else 1.0 - loop.share if loop is not None and whole else 1.0
        rate = left * damping
        for induced in plant.all(AbstractInduced, DRIVE_OF_AXIS[axis]):
            rate = rate + np.abs(np.asarray(gain)) * induced.constant
        found[axis] = _most(np.asarray(rate / masses[axis]))
    return found


def paces(plant: Plant, damped: Sequence[str] = ()) -> tuple[list[float], list[float]]:
    """Steps per second that each part asks for: those that are decided within a step, and those that are not. Each
    rises or falls with a number of the plant whatever the others are.

    Args:
        plant: see `longest_step`.
        damped: see `equations.accelerations`.
    """
    b, train, rope = plant.bridge, plant.drive_train, plant.only(RopeElasticity)
    cart, load, winch = (np.asarray(mass) for mass in (b.cart_mass, b.load_mass, b.winch_mass))
    motor = cart if train is None else np.asarray(train.motor_mass)
    decided, squares = list[float](), list[float]()
    fading = list(_fading(plant, damped).values())
    if isinstance(train, BeltCompliance):
        decided.append(_most(train.stiffness * (1.0 / motor + 1.0 / np.maximum(cart - motor, 1e-3 * motor))))
    spring = plant.hysteresis
    if spring is not None:
        decided.append(_most(spring.steepness() / motor))
    if rope is not None:
        ease = 1.0 / winch + 1.0 / load
        squares.append(_most(rope.stiffness * ease))
        fading.append(_most(rope.damping * ease))
    hook = plant.only(DoublePendulum)
    if hook is not None:
        below = np.maximum(load - hook.hook_mass, 1e-3 * load)
        squares.append(_most(b.gravity / hook.link * load / hook.hook_mass))
        fading.append(_most(hook.damping / hook.link**2 * (1.0 / below + 1.0 / hook.hook_mass)))
    explicit = [math.sqrt(each) / _TURN for each in squares] + [each / _FADE for each in fading]
    return [math.sqrt(each) / _TURN for each in decided], explicit


def _most(values: Array | np.ndarray) -> float:
    return float(np.max(np.asarray(values)))
