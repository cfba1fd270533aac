"""The plant: a bridge with the effects that act on it, as one acceleration.

Hidden coordinates come with mechanisms: the `motor` behind a belt or a play, the `loaded` rope length behind an
elastic rope, the angle `phi` below a hook. Motor and winch are coupled to the rest by a force alone, so they keep
masses of their own; only the hook's angle enlarges the coupled mass matrix. What sticks, what meets and what rings
between motor and cart is decided over a whole step (`dry`, `drive_train`), and so is a stiff speed loop (`speed_loop`).
"""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._math import materialise, sincos
from .._programs import returned
from .._types import Axes, Scalar
from .bridge import Bridge, Symmetric, inverse
from .drive_train import Sides, through_belt, through_play
from .dry import Rows, friction
from .effects.base import (
    AXIS_OF_SITE,
    DRIVE_OF_AXIS,
    AbstractDamping,
    AbstractEffect,
    AbstractForce,
    AbstractFriction,
    AbstractHysteresis,
    AbstractMechanism,
)
from .effects.bodies import AbstractBody
from .effects.drives import LAGS, BackEmf, DrumRadiusChange, ForceLimit, SpeedDrive, TorqueRipple
from .effects.flexible import Backlash, BeltCompliance, DoublePendulum, HoistBacklash, RopeElasticity
from .effects.sensors import ClockScale
from .speed_loop import Loop, held

E = TypeVar("E", bound=AbstractEffect)
T = TypeVar("T")


@returned
class Motion(NamedTuple):
    """Positions, velocities or accelerations of all coordinates; hidden ones are None where there is no mechanism."""

    x: Scalar
    psi: Scalar
    l: Scalar  # noqa: E741
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


class Push(NamedTuple):
    """Something added to a plant from outside: forces at the load's side, and friction levels."""

    force: Axes
    up: Axes
    down: Axes


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
        return jax.lax.cond(jnp.any(jnp.stack(present)), law, lambda same: same, value)

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

    @property
    def hidden(self) -> tuple[str, ...]:
        """Hidden states that follow those of the axes in an initial-state vector, by name and in order."""
        found = {
            "motor": self.drive_train,
            "loaded": self.rope_end,
            "phi": self.only(DoublePendulum),
            "spring": self.hysteresis,
        }
        return tuple(name for name, effect in found.items() if effect is not None)

    def drive_forces(self, volts: Axes, q: Motion, v: Motion) -> Axes:
        """Motor forces [N] for inputs after the drives' chains; `volts.psi` is ignored.

        Speed loops are not in them: see `SpeedDrive`.
        """
        zero, places, speeds = jnp.zeros_like(volts.x), q.at_drives(), v.at_drives()
        found = {}
        for axis, gain in (("x", self.bridge.cart_gain), ("l", self.bridge.hoist_gain)):
            u, place, speed = getattr(volts, axis), getattr(places, axis), getattr(speeds, axis)
            site = DRIVE_OF_AXIS[axis]
            for induced in self.all(BackEmf, site):
                u = self.after(functools.partial(_less, induced, speed), u, induced)
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

    def drive_rate(self, axis: str, loop: SpeedDrive) -> Scalar:
        """Force per speed of a speed loop [N s/m]: its share of the axis' damping."""
        return loop.share * (self.bridge.cart_damping if axis == "x" else self.bridge.hoist_damping)

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
                taken = self.drive_rate(axis, loop) * getattr(v, axis)
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
        """Time constants of the drives' lags [s], 0 where there is none."""
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

    def smooth_forces(self, t: Scalar, q: Motion, v: Motion) -> tuple[Axes, Axes]:
        """Forces at the load's side (cart, swing, loaded rope) and resistances at the drives' side [N, N m, N]."""
        load_q, load_v = q.at_load(), v.at_load()
        total = Axes(*(jnp.zeros_like(q.x) for _ in range(3)))
        for effect in self.all(AbstractForce):

            def pushed(total: Axes, effect: AbstractForce = effect) -> Axes:
                return Axes(*(a + b for a, b in zip(total, effect.force(t, load_q, load_v), strict=True)))

            total = self.after(pushed, total, effect)
        drives_q, drives_v = q.at_drives(), v.at_drives()
        resistance = self.bridge.viscous(drives_v)._asdict()
        for damping in self.all(AbstractDamping):

            def resisted(force: Scalar, damping: AbstractDamping = damping) -> Scalar:
                return force + damping.resistance(drives_q, drives_v)

            axis = AXIS_OF_SITE[damping.site]
            resistance[axis] = self.after(resisted, resistance[axis], damping)
        return total, Axes(**resistance)

    def acceleration(
        self,
        t: Scalar,
        q: Motion,
        v: Motion,
        volts: Axes,
        z: Scalar | None,
        active: Axes,
        first: tuple[Motion, Motion],
        h: Scalar,
        go: Array,
        push: Push | None = None,
        lead: Scalar | float = 0.0,
        setpoints: tuple[Axes, Axes] | None = None,
    ) -> Motion:
        """Accelerations of all coordinates [m/s^2, rad/s^2].

        Args:
            t: time from the recording's start [s].
            q, v: positions and velocities.
            volts: inputs behind the drives' chains, in the input's unit.
            z: relative deflection of a hysteresis' spring, None without one.
            active: 1 for an axis that moves, 0 for one that is locked or absent.
            first: positions and velocities at the step's beginning, from which friction and contact are judged.
            h: length of the step [s]; the mean friction over it is used.
            go: true, for `materialise`.
            push: forces and friction levels to add.
            lead: the stage's, see `rollout.Method`.
            setpoints: `volts` at the step's beginning and end, for speed loops; steady `volts` if None.
        """
        train, rope, hook = self.drive_train, self.rope_end, self.only(DoublePendulum)
        b = self.bridge
        load_q, load_v = q.at_load(), v.at_load()
        # A cart alone carries no load.
        loaded = jnp.maximum(active.psi, active.l)
        swing = materialise(sincos(load_q.psi), go)
        m, bias = self.inertia(load_q, load_v, loaded, swing)
        xx = m.xx if train is None else m.xx - train.motor_mass
        winch = rope.motor_mass if isinstance(rope, HoistBacklash) else b.winch_mass
        ll = m.ll if rope is None else m.ll - winch
        m = m._replace(xx=xx, ll=ll)
        # The rope's far end moves freely where it is parted from the winch, even if that is locked.
        block = active if rope is None else active._replace(l=loaded)
        force, resistance = materialise(self.smooth_forces(t, q, v), go)
        if push is not None:
            force = Axes(*(a + b for a, b in zip(force, push.force, strict=True)))
        wanted = self.drive_forces(volts, q, v)
        drive, resistance = self.looped(wanted, resistance, v.at_drives())
        loops = {}
        if train is None and rope is None and any(self.all(SpeedDrive)):
            start, end = (volts, volts) if setpoints is None else setpoints
            loops = self._loops(self.drive_forces(start, q, v), self.drive_forces(end, q, v), first[1].axes)
        at_x = resistance.x if "x" in loops else drive.x + resistance.x
        at_l = resistance.l if "l" in loops else drive.l + resistance.l
        spring = self.hysteresis
        if spring is not None and z is not None:
            at_x = at_x + spring.force(q.at_drives().x, z)
        f_x = force.x - bias.x
        f_psi = force.psi + resistance.psi - bias.psi
        f_l = force.l - bias.l
        if train is None:
            f_x = f_x + at_x
        if rope is None:
            f_l = f_l + at_l
        elif isinstance(rope, RopeElasticity):
            tension = rope.stiffness * (load_q.l - q.l) + rope.damping * (load_v.l - v.l)
            f_l = f_l - tension
            at_l = at_l + tension

        if hook is None:
            inv = inverse(m, block)
            free = inv @ Axes(f_x, f_psi, f_l)
            a_phi, to_phi = None, None
        else:
            inv, free, a_phi, to_phi = _with_hook(hook, b, m, block, load_q, load_v, q, v, Axes(f_x, f_psi, f_l))

        # Rows of the friction problem: cart (or motor), swing, hoist (or winch).
        w_x = inv.xx if train is None else active.x / train.motor_mass
        w_l = inv.ll if rope is None else active.l / winch
        w_xp = inv.xp if train is None else jnp.zeros_like(inv.xp)
        w_xl = inv.xl if train is None and rope is None else jnp.zeros_like(inv.xl)
        w_pl = inv.pl if rope is None else jnp.zeros_like(inv.pl)
        a_motor = None if train is None else at_x * active.x / train.motor_mass
        a_winch = None if rope is None else at_l * active.l / winch
        rest = Axes(free.x if a_motor is None else a_motor, free.psi, free.l if a_winch is None else a_winch)
        positive, negative = self.friction_levels(t, q.at_drives(), v.at_drives(), self.loads(load_q, load_v, drive))
        if push is not None:
            positive = Axes(*(a + b for a, b in zip(positive, push.up, strict=True)))
            negative = Axes(*(a + b for a, b in zip(negative, push.down, strict=True)))
        w = ((w_x, w_xp, w_xl), (w_xp, inv.pp, w_pl), (w_xl, w_pl, w_l))
        w, rest, inv, free, positive, negative = materialise((w, rest, inv, free, positive, negative), go)
        rubbing = [push is not None or self.has_friction(axis) for axis in Axes._fields]
        moving = first[1].at_drives()
        rows = Rows(rest, w, moving, positive, negative)
        thrust, pull = None, None
        if isinstance(rope, HoistBacklash):
            ahead, speed = first[0].l - first[0].at_load().l, moving.l - first[1].at_load().l
            sides = Sides(ahead, speed, rest.l - free.l, (inv.xl, inv.pl, -w_l), w_l + inv.ll + _TINY)
            f, pull = through_play(rows, sides, rope.gap, rubbing, h, lead, go)
        elif loops:
            f, pulls = held(rows, {Axes._fields.index(a): loop for a, loop in loops.items()}, rubbing, h, lead, go)
            f = [own + pulls.get(i, 0.0) for i, own in enumerate(f)]
        elif train is None:
            f = friction(rows, rubbing, h, go)
        else:
            u = (-w_x, inv.xp, inv.xl if rope is None else jnp.zeros_like(inv.xl))
            apart, rate = first[0].at_drives().x - first[0].x, moving.x - first[1].x
            sides = Sides(apart, rate, rest.x - free.x, u, w_x + inv.xx + _TINY)
            if isinstance(train, Backlash):
                f, thrust = through_play(rows, sides, train.gap, rubbing, h, lead, go)
            else:
                drag = b.cart_damping * w_x, v.at_drives().x - v.x
                f, thrust = through_belt(rows, sides, (train.stiffness, train.damping), drag, rubbing, h, lead, go)
        zero = jnp.zeros_like(q.x)
        f_block = Axes(f[0] if train is None else zero, f[1], f[2] if rope is None else zero)
        if thrust is not None:
            assert a_motor is not None
            f_block = f_block._replace(x=f_block.x + thrust)
            a_motor = a_motor - thrust * w_x
        if pull is not None:
            assert a_winch is not None
            f_block = f_block._replace(l=f_block.l + pull)
            a_winch = a_winch - pull * w_l
        change = inv @ f_block
        a = Axes(*(p + c for p, c in zip(free, change, strict=True)))
        if to_phi is not None and a_phi is not None:
            a_phi = a_phi + to_phi.x * f_block.x + to_phi.psi * f_block.psi + to_phi.l * f_block.l
        return Motion(
            a.x,
            a.psi,
            a.l if a_winch is None else a_winch + w_l * f[2],
            None if a_motor is None else a_motor + w_x * f[0],
            None if rope is None else a.l,
            a_phi,
        )

    def _loops(self, start: Axes, end: Axes, v: Axes) -> dict[str, Loop]:
        """Speed loops by axis, as they are solved over a whole step where no contact or belt is.

        Args:
            start, end: `drive_forces` for the inputs at the step's beginning and end [N].
            v: velocities at the step's beginning.
        """
        found = {}
        for axis in DRIVE_OF_AXIS:
            loop = self.speed_loop(axis)
            if loop is not None:
                rate, force = self.drive_rate(axis, loop), getattr(start, axis)
                gained = getattr(end, axis) - force
                found[axis] = Loop(force - rate * getattr(v, axis), gained, rate, loop.limit)
        return found


def _less(effect: BackEmf, speed: Scalar, u: Scalar) -> Scalar:
    return effect.less(u, speed)


_TINY = 1e-30
"""Keeps finite the thrust on a cart, or the pull on a load, that is fixed."""


def _with_hook(
    hook: DoublePendulum,
    b: Bridge,
    m: Symmetric,
    active: Axes,
    q: Axes,
    v: Axes,
    hidden_q: Motion,
    hidden_v: Motion,
    force: Axes,
) -> tuple[Symmetric, Axes, Scalar, Axes]:
    """Adds the link below the hook: its angle enlarges the mass matrix, here by a Schur complement.

    Returns:
        The inverse mass matrix over the axes, their accelerations, that of `phi`, and the response of `phi` to
        forces on the axes.
    """
    phi, phi_rate = hidden_q.phi, hidden_v.phi
    assert phi is not None and phi_rate is not None
    mass, link = b.load_mass - hook.hook_mass, hook.link
    sine, cosine = sincos(q.psi)
    sine_phi, cosine_phi = sincos(phi)
    # cos(psi - phi) and sin(psi - phi)
    along = cosine * cosine_phi + sine * sine_phi
    across = sine * cosine_phi - cosine * sine_phi
    column = Axes(mass * link * cosine_phi, mass * link * q.l * along, mass * link * across)
    pull = mass * link * phi_rate * phi_rate
    torque = hook.damping * (phi_rate - v.psi)
    force = Axes(
        force.x + pull * sine_phi,
        force.psi + q.l * pull * (cosine * sine_phi - sine * cosine_phi) + torque,
        force.l + pull * along,
    )
    hook_x = 2.0 * v.l * v.psi * cosine - q.l * v.psi * v.psi * sine
    hook_down = -2.0 * v.l * v.psi * sine - q.l * v.psi * v.psi * cosine
    f_phi = -mass * link * (cosine_phi * hook_x - sine_phi * hook_down + b.gravity * sine_phi) - torque
    inv = inverse(m, active)
    reach = inv @ column
    d = mass * link * link
    schur = d - (column.x * reach.x + column.psi * reach.psi + column.l * reach.l)
    first = inv @ force
    a_phi = (f_phi - (column.x * first.x + column.psi * first.psi + column.l * first.l)) / schur
    a = Axes(*(p - r * a_phi for p, r in zip(first, reach, strict=True)))
    full = Symmetric(
        inv.xx + reach.x * reach.x / schur,
        inv.xp + reach.x * reach.psi / schur,
        inv.xl + reach.x * reach.l / schur,
        inv.pp + reach.psi * reach.psi / schur,
        inv.pl + reach.psi * reach.l / schur,
        inv.ll + reach.l * reach.l / schur,
    )
    to_phi = Axes(-reach.x / schur, -reach.psi / schur, -reach.l / schur)
    return full, a, a_phi, to_phi
