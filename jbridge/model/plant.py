"""The plant: a bridge and the effects that act on it, with the forces, levels and masses that these add up to.

Hidden coordinates come with mechanisms: the `motor` behind a belt or a play, the `loaded` rope length behind an
elastic rope, the angle `phi` below a hook. `equations` has the accelerations.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._math import sincos
from .._types import Axes, Scalar
from ..compilation.programs import returned
from .bridge import Bridge, Symmetric
from .effects.base import (
    AXIS_OF_SITE,
    DRIVE_OF_AXIS,
    SWING,
    AbstractDamping,
    AbstractEffect,
    AbstractForce,
    AbstractFriction,
    AbstractHysteresis,
    AbstractMechanism,
)
from .effects.bodies import AbstractBody
from .effects.drives import DrumRadiusChange, TorqueRipple
from .effects.flexible import Backlash, BeltCompliance, HoistBacklash, RopeElasticity
from .effects.motors import LAGS, AbstractInduced, ForceLimit, SpeedDrive
from .effects.sensors import ClockScale
from .speed_loop import Loop

E = TypeVar("E", bound=AbstractEffect)
T = TypeVar("T")


@returned
class Motion(NamedTuple):
    """Positions, velocities or accelerations of all coordinates; hidden ones are None where there is no mechanism."""

    x: Scalar
    psi: Scalar
    l: Scalar
    motor: Scalar | None = None
    loaded: Scalar | None = None
    phi: Scalar | None = None

    @property
    def axes(self) -> Axes:
        return Axes(self.x, self.psi, self.l)

    def at_load(self) -> Axes:
        """Cart, swing, and the length at which the load hangs."""
        return Axes(self.x, self.psi, self.l if self.loaded is None else self.loaded)

    def at_drives(self) -> Axes:
        """Where motor and winch sit: friction and damping act there."""
        return Axes(self.x if self.motor is None else self.motor, self.psi, self.l)


_Inertia: TypeAlias = tuple[Symmetric, Axes]
_Pair: TypeAlias = tuple[Scalar, Scalar]
_Four: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]


class Plant(eqx.Module):
    """A bridge and its effects. `Plant(bridge)` is the rigid, viscous bridge."""

    bridge: Bridge
    effects: tuple[AbstractEffect, ...] = ()
    present: Bool[Array, " effect"] | None = None
    """Which of the effects act, where one program serves models with different ones; None if all do."""

    def adding(self, *effects: AbstractEffect) -> "Plant":
        """The same plant with further effects."""
        return Plant(self.bridge, (*self.effects, *effects))

    def all(self, cls: type[E], site: str | None = None) -> Iterator[E]:
        """The effects of a class, at one site or everywhere."""
        for effect in self.effects:
            if isinstance(effect, cls) and site in (None, effect.site):
                yield effect

    def after(self, law: Callable[[T], T], value: T, *effects: AbstractEffect) -> T:
        """`law(value)`, what effects make of a value; the value itself, and no work, where all of them are absent."""
        if self.present is None:
            return law(value)
        present = [self.present[k] for k, own in enumerate(self.effects) if any(own is effect for effect in effects)]
        # JAX hashes what it is given, and a method has the hash of its effect, whose numbers have none here.
        return jax.lax.cond(jnp.any(jnp.stack(present)), lambda given: law(given), lambda same: same, value)

    def after_each(self, law: Callable[[E, T], T], value: T, effects: Iterable[E]) -> T:
        """What one effect after the other makes of a value; one question, and no work, where all of them are absent."""
        every = tuple(effects)

        def one_by_one(value: T) -> T:
            for effect in every:
                value = self.after(functools.partial(law, effect), value, effect)
            return value

        return self.after(one_by_one, value, *every) if len(every) > 1 else one_by_one(value)

    def only(self, cls: type[E], site: str | None = None) -> E | None:
        """The one effect of a class, or None.

        Raises:
            ValueError: there are two, where physics has room for one.
        """
        found = list(self.all(cls, site))
        if len(found) > 1:
            raise ValueError(f"a model holds at most one {found[0].kind} at {found[0].site}, and here are {len(found)}")
        return found[0] if found else None

    def check(self) -> None:
        """Raises ValueError where effects stand together that physics has room for one of."""
        _ = self.drive_train, self.rope_end, self.hysteresis
        _ = [self.speed_loop(axis) for axis in DRIVE_OF_AXIS]
        for mechanism in self.mechanisms:
            self.only(type(mechanism))

    @property
    def drive_train(self) -> BeltCompliance | Backlash | None:
        belt, play = self.only(BeltCompliance), self.only(Backlash)
        if belt is not None and play is not None:
            raise ValueError("belt_compliance and backlash both stand between motor and cart: keep one of them")
        return belt if belt is not None else play

    @property
    def rope_end(self) -> RopeElasticity | HoistBacklash | None:
        """What parts the load's end of the rope from the winch's motor."""
        rope, play, train = self.only(RopeElasticity), self.only(HoistBacklash), self.drive_train
        if rope is not None and play is not None:
            raise ValueError("rope_elasticity and hoist_backlash both stand between winch and load: keep one of them")
        if play is not None and train is not None:
            raise ValueError(f"hoist_backlash and {train.kind} are contacts of two drives at once: keep one of them")
        return rope if rope is not None else play

    @property
    def hysteresis(self) -> AbstractHysteresis | None:
        kinds = list(dict.fromkeys(effect.kind for effect in self.all(AbstractHysteresis)))
        if len(kinds) > 1:
            raise ValueError(f"{' and '.join(kinds)} both hold the cart with a hidden spring: keep one of them")
        return self.only(AbstractHysteresis)

    @property
    def mechanisms(self) -> tuple[AbstractMechanism, ...]:
        return tuple(self.all(AbstractMechanism))

    @property
    def states(self) -> int:
        """Length of an initial-state vector, in which a hysteresis' deflection may follow."""
        return 6 + 2 * len(self.mechanisms)

    def drive_forces(self, volts: Axes, q: Motion, v: Motion) -> Axes:
        """Motor forces [N] for inputs after the drives' chains; `volts.psi` is ignored.

        Speed loops are not in them: see `SpeedDrive`.
        """
        zero, places, speeds = jnp.zeros_like(volts.x), q.at_drives(), v.at_drives()
        found = {}
        for axis, gain in (("x", self.bridge.cart_gain), ("l", self.bridge.hoist_gain)):
            u, place, speed = getattr(volts, axis), getattr(places, axis), getattr(speeds, axis)
            site = DRIVE_OF_AXIS[axis]
            for induced in self.all(AbstractInduced, site):
                # A motor that is wired the other way round brakes itself as well.
                along = speed * jnp.sign(gain)
                u = self.after(functools.partial(induced.less, getattr(volts, axis), along), u, induced)
            force = gain * u
            for ripple in self.all(TorqueRipple, site):

                def rippled(force: Scalar, effect: TorqueRipple = ripple, place: Scalar = place) -> Scalar:
                    return force * effect.gain(place)

                force = self.after(rippled, force, ripple)
            for limit in self.all(ForceLimit, site):
                force = self.after(limit.clipped, force, limit)
            found[axis] = force
        return Axes(found["x"], zero, found["l"])

    def speed_loop(self, axis: str) -> SpeedDrive | None:
        """The drive of an axis that holds a speed, if it has one."""
        return self.only(SpeedDrive, DRIVE_OF_AXIS[axis]) if axis in DRIVE_OF_AXIS else None

    def drive_rate(self, axis: str) -> Scalar:
        """Force per speed of an axis' drive [N s/m]: the share that a speed loop has of its damping, or all of it."""
        loop, damping = self.speed_loop(axis), self.bridge.cart_damping if axis == "x" else self.bridge.hoist_damping
        return damping if loop is None else loop.share * damping

    def looped(self, drive: Axes, resistance: Axes, v: Axes) -> tuple[Axes, Axes]:
        """Forces of the drives, and resistances, where speed loops take their share of the damping.

        Args:
            drive: `drive_forces` [N].
            resistance: see `smooth_forces` [N, N m, N].
            v: velocities at the drives.
        """
        for axis in DRIVE_OF_AXIS:
            loop = self.speed_loop(axis)
            if loop is not None:
                taken = self.drive_rate(axis) * getattr(v, axis)
                force = jnp.clip(getattr(drive, axis) - taken, -loop.limit, loop.limit)
                drive = drive._replace(**{axis: force})
                resistance = resistance._replace(**{axis: getattr(resistance, axis) + taken})
        return drive, resistance

    def drum_gain(self, length: Scalar) -> Scalar:
        """Relative gain of the winch at a rope length [m]."""
        gain = jnp.ones_like(length)
        for effect in self.all(DrumRadiusChange):
            gain = gain * (1.0 + effect.slope * (length - effect.length))
        return gain

    def time_scale(self) -> Scalar | float:
        """True time over recorded time."""
        scale: Scalar | float = 1.0
        for effect in self.all(ClockScale):
            scale = scale * effect.scale
        return scale

    def time_constants(self) -> Axes:
        """Time constants of the drives' lags [s], 0 where there is none; those of one drive act as their sum."""
        found = {"x": jnp.zeros(()), "l": jnp.zeros(())}
        for effect in self.effects:
            if isinstance(effect, LAGS):
                axis = AXIS_OF_SITE[effect.site]
                found[axis] = found[axis] + effect.time_constant
        return Axes(found["x"], jnp.zeros(()), found["l"])

    def inertia(
        self, q: Axes, v: Axes, loaded: Scalar | float, swing: tuple[Scalar, Scalar] | None = None
    ) -> tuple[Symmetric, Axes]:
        """`M(q)` and `bias(q, v)` of the bridge with the bodies that swing beside its load.

        Args:
            q, v: positions and velocities at the load.
            loaded: 1 where a load hangs from the cart, 0 for a cart alone, which carries none.
            swing: sine and cosine of `q.psi`, where they are known already.
        """
        turned = sincos(q.psi) if swing is None else swing
        m, bias = self.bridge.mass_matrix(q, turned), self.bridge.bias(q, v, turned)
        m = m._replace(xx=m.xx - self.bridge.load_mass * (1.0 - loaded))
        for body in self.all(AbstractBody):

            def swings(parts: _Inertia, body: AbstractBody = body) -> _Inertia:
                own, pull = body.mass_matrix(turned), body.bias(v, self.bridge.gravity, turned)
                own = own._replace(xx=loaded * own.xx)
                return (
                    Symmetric(*(a + b for a, b in zip(parts[0], own, strict=True))),
                    Axes(*(a + b for a, b in zip(parts[1], pull, strict=True))),
                )

            m, bias = self.after(swings, (m, bias), body)
        return m, bias

    def stretch(self) -> Scalar:
        """Static elongation of an elastic rope under the load [m]."""
        rope = self.only(RopeElasticity)
        if rope is None:
            return jnp.zeros(())
        return self.bridge.load_mass * self.bridge.gravity / rope.stiffness

    def loads(self, q: Axes, v: Axes, drive: Axes) -> Axes:
        """What friction may grow with: the forces of the drives, and the pull on the swing's pivot [N].

        Args:
            q, v: positions and velocities at the load.
            drive: forces of the motors [N].
        """
        swing, gravity = sincos(q.psi), self.bridge.gravity
        pull = self.bridge.load_mass * (gravity * swing[1] + q.l * v.psi * v.psi)
        for body in self.all(AbstractBody):
            pull = pull + body.pull(v, gravity, swing)
        return drive._replace(psi=pull)

    def friction_levels(self, t: Scalar, q: Axes, v: Axes, load: Axes) -> tuple[Axes, Axes]:
        """Levels against positive and against negative motion, of all effects of each axis under these `loads`."""
        zero = jnp.zeros_like(v.x)
        total = dict.fromkeys(Axes._fields, (zero, zero))
        for effect in self.all(AbstractFriction):
            axis = AXIS_OF_SITE[effect.site]
            at = t, getattr(q, axis), getattr(v, axis), getattr(load, axis)

            def law(levels: _Pair, effect: AbstractFriction = effect, at: _Four = at) -> _Pair:
                up, down = effect.levels(*at)
                return levels[0] + up, levels[1] + down

            total[axis] = self.after(law, total[axis], effect)
        return Axes(*(up for up, _ in total.values())), Axes(*(down for _, down in total.values()))

    def has_friction(self, axis: str) -> bool:
        """Whether any dry friction that sticks acts on an axis (`x`, `psi` or `l`)."""
        return any(AXIS_OF_SITE[effect.site] == axis for effect in self.all(AbstractFriction))

    def smooth_forces(self, t: Scalar, q: Motion, v: Motion, loaded: Scalar | float = 1.0) -> tuple[Axes, Axes]:
        """Forces at the load's side (cart, swing, loaded rope) and resistances at the drives' side [N, N m, N].

        Args:
            t, q, v: time, and positions and velocities then.
            loaded: see `inertia`.
        """
        load_q, load_v = q.at_load(), v.at_load()
        total = Axes(*(jnp.zeros_like(q.x) for _ in range(3)))
        for effect in self.all(AbstractForce):

            def pushed(total: Axes, effect: AbstractForce = effect) -> Axes:
                force = effect.force(t, load_q, load_v)
                if effect.site == SWING:
                    force = force._replace(x=loaded * force.x)
                return Axes(*(a + b for a, b in zip(total, force, strict=True)))

            total = self.after(pushed, total, effect)
        drives_q, drives_v = q.at_drives(), v.at_drives()
        resistance = self.bridge.viscous(drives_v)._asdict()
        for damping in self.all(AbstractDamping):

            def resisted(force: Scalar, damping: AbstractDamping = damping) -> Scalar:
                return force + damping.resistance(drives_q, drives_v)

            axis = AXIS_OF_SITE[damping.site]
            resistance[axis] = self.after(resisted, resistance[axis], damping)
        return total, Axes(**resistance)

    def speed_loops(self, start: Axes, end: Axes, v: Axes, damped: Sequence[str]) -> dict[str, Loop]:
        """Speed loops by axis, as they are solved over a whole step where no contact or belt is.

        Args:
            start, end: `drive_forces` for the inputs at the step's beginning and end [N].
            v: velocities at the step's beginning.
            damped: axes whose viscous damping counts as one, without a limit.
        """
        found = {}
        for axis in DRIVE_OF_AXIS:
            loop = self.speed_loop(axis)
            if loop is not None or axis in damped:
                rate, force = self.drive_rate(axis), getattr(start, axis)
                gained = getattr(end, axis) - force
                limit = None if loop is None else loop.limit
                found[axis] = Loop(force - rate * getattr(v, axis), gained, rate, limit)
        return found
