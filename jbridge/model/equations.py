"""The equations of motion: accelerations of all coordinates, from one stage of an integration step.

Motor and winch are coupled to the rest by a force alone, so they keep masses of their own; only the angle of a link
below the hook enlarges the coupled mass matrix. What sticks, what meets and what rings between motor and cart is
decided over a whole step (`dry_friction`, `drive_train`), and so are a speed loop and stiff damping (`speed_loop`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._math import materialise, sincos
from .._types import Axes, Scalar
from .bridge import Bridge, Symmetric, inverse
from .drive_train import Belt, Sides, through_belt, through_play
from .dry_friction import Rows, friction
from .effects.base import DRIVE_OF_AXIS
from .effects.flexible import Backlash, DoublePendulum, HoistBacklash, RopeElasticity
from .effects.motors import SpeedDrive
from .plant import Motion, Plant
from .speed_loop import Loop, held, shares

_TINY = 1e-30
"""Keeps finite the thrust on a cart, or the pull on a load, that is fixed."""


class Stage(NamedTuple):
    """Where a stage of a step asks for accelerations."""

    t: Scalar
    """Time from the recording's start [s]."""
    q: Motion
    v: Motion
    volts: Axes
    """Inputs behind the drives' chains, in the input's unit."""
    z: Scalar | None = None
    """Relative deflection of a hysteresis' spring, None without one."""
    lead: Scalar | float = 0.0
    """See `runge_kutta.Method`."""


class Step(NamedTuple):
    """What the stages of a step have in common."""

    q: Motion
    """Positions at its beginning,"""
    v: Motion
    """and velocities, from which friction and contact are judged."""
    h: Scalar
    """Its length [s]; the mean friction over it is used."""
    active: Axes
    """1 for an axis that moves, 0 for one that is locked or absent."""
    go: Array
    """True, for `materialise`."""
    setpoints: tuple[Axes, Axes] | None = None
    """Inputs at the step's beginning and end, for speed loops; those of the stage if None."""


class _Forces(NamedTuple):
    """What acts beside inertia and dry friction [N, N m, N]."""

    load: Axes
    """At the load's side."""
    pivot: Scalar
    """Against the swing, at its pivot."""
    motor: Scalar
    """All that acts on the cart's drive."""
    winch: Scalar
    """All that acts on the winch, the pull of an elastic rope included."""
    tension: Scalar | None
    """Pull of an elastic rope."""
    drive: Axes
    """Forces of the motors alone."""
    loops: dict[str, Loop]
    """Speed loops, and damping like theirs, that are solved over a whole step, by axis; in none of the other forces."""


class _Coupled(NamedTuple):
    """Cart, swing and rope at the load, which the mass matrix couples, and a link below the hook, before friction."""

    inverse: Symmetric
    a: Axes
    a_phi: Scalar | None = None
    to_phi: Axes | None = None
    """What forces on the axes do to the link's angle."""


class _Contact(NamedTuple):
    """Dry friction of each row, and what passes between a drive and its side of the load [N]."""

    friction: Sequence[Scalar]
    thrust: Scalar | None = None
    """Of the motor on the cart,"""
    pull: Scalar | None = None
    """and of the winch on the load."""


def accelerations(plant: Plant, stage: Stage, step: Step, *, damped: Sequence[str] = ()) -> Motion:
    """Accelerations of all coordinates [m/s^2, rad/s^2].

    Args:
        plant: what moves.
        stage: where.
        step: of which it is a part.
        damped: axes whose viscous damping at the drive is solved over the step in closed form, as speed loops are;
            where something parts one drive from its axis, such a one alone.
    """
    forces = _forces(plant, stage, step, damped)
    coupled = _coupled(plant, stage, step, forces)
    rows, coupled = _rows(plant, stage, step, forces, coupled)
    rows = _damped(plant, stage, step, rows, damped)
    contact = _contact(plant, stage, step, forces, coupled, rows, damped)

    has_motor, has_winch = plant.drive_train is not None, plant.rope_end is not None
    f, a_motor, a_winch = contact.friction, rows.rest[0], rows.rest[2]
    w_motor, w_winch = rows.w[0][0], rows.w[2][2]
    zero = jnp.zeros_like(stage.q.x)
    on_block = Axes(zero if has_motor else f[0], f[1], zero if has_winch else f[2])
    if contact.thrust is not None:
        on_block = on_block._replace(x=on_block.x + contact.thrust)
        a_motor = a_motor - contact.thrust * w_motor
    if contact.pull is not None:
        on_block = on_block._replace(l=on_block.l + contact.pull)
        a_winch = a_winch - contact.pull * w_winch
    change = coupled.inverse @ on_block
    a = Axes(*(p + c for p, c in zip(coupled.a, change, strict=True)))
    a_phi, to_phi = coupled.a_phi, coupled.to_phi
    if to_phi is not None and a_phi is not None:
        a_phi = a_phi + to_phi.x * on_block.x + to_phi.psi * on_block.psi + to_phi.l * on_block.l
    return Motion(
        a.x,
        a.psi,
        a_winch + w_winch * f[2] if has_winch else a.l,
        a_motor + w_motor * f[0] if has_motor else None,
        a.l if has_winch else None,
        a_phi,
    )


def _forces(plant: Plant, stage: Stage, step: Step, damped: Sequence[str]) -> _Forces:
    t, q, v, volts = stage.t, stage.q, stage.v, stage.volts
    train, rope = plant.drive_train, plant.rope_end
    load, resistance = materialise(plant.smooth_forces(t, q, v, _loaded(step)), step.go)
    drive, resistance = plant.looped(plant.drive_forces(volts, q, v), resistance, v.at_drives())
    loops = {}
    if train is None and rope is None and (damped or any(plant.all(SpeedDrive))):
        start, end = (volts, volts) if step.setpoints is None else step.setpoints
        forces = plant.drive_forces(start, q, v), plant.drive_forces(end, q, v)
        loops = plant.speed_loops(*forces, step.v.axes, damped)
    viscous = plant.bridge.viscous(v.at_drives())
    motor, winch = (
        (getattr(resistance, axis) - (getattr(viscous, axis) if plant.speed_loop(axis) is None else 0.0))
        if axis in loops
        else getattr(drive, axis) + getattr(resistance, axis)
        for axis in DRIVE_OF_AXIS
    )
    spring = plant.hysteresis
    if spring is not None and stage.z is not None:
        motor = motor + spring.force(q.at_drives().x, stage.z)
    tension = None
    if isinstance(rope, RopeElasticity):
        tension = rope.stiffness * (q.at_load().l - q.l) + rope.damping * (v.at_load().l - v.l)
        winch = winch + tension
    return _Forces(load, resistance.psi, motor, winch, tension, drive, loops)


def _loaded(step: Step) -> Scalar:
    """1 where a load hangs from the cart, 0 for a cart alone, which carries none."""
    return jnp.maximum(step.active.psi, step.active.l)


def _coupled(plant: Plant, stage: Stage, step: Step, forces: _Forces) -> _Coupled:
    """What the mass matrix makes of the forces."""
    train, rope = plant.drive_train, plant.rope_end
    q, v, active = stage.q.at_load(), stage.v.at_load(), step.active
    loaded = _loaded(step)
    m, bias = plant.inertia(q, v, loaded, materialise(sincos(q.psi), step.go))
    m = m._replace(
        xx=m.xx if train is None else m.xx - train.motor_mass, ll=m.ll if rope is None else m.ll - _winch_mass(plant)
    )
    f = Axes(forces.load.x - bias.x, forces.load.psi + forces.pivot - bias.psi, forces.load.l - bias.l)
    if train is None:
        f = f._replace(x=f.x + forces.motor)
    if rope is None:
        f = f._replace(l=f.l + forces.winch)
    elif forces.tension is not None:
        f = f._replace(l=f.l - forces.tension)
    # The rope's far end moves freely where it is parted from the winch, even if that is locked.
    inv = inverse(m, active if rope is None else active._replace(l=loaded))
    hook = plant.only(DoublePendulum)
    return _Coupled(inv, inv @ f) if hook is None else _with_hook(hook, plant.bridge, stage, inv, f, loaded)


def _rows(plant: Plant, stage: Stage, step: Step, forces: _Forces, coupled: _Coupled) -> tuple[Rows, _Coupled]:
    """The friction problem, whose rows are cart (or motor), swing, hoist (or winch)."""
    train, rope = plant.drive_train, plant.rope_end
    inv, zero = coupled.inverse, jnp.zeros_like(coupled.inverse.xp)
    w_x = inv.xx if train is None else step.active.x / train.motor_mass
    w_l = inv.ll if rope is None else step.active.l / _winch_mass(plant)
    w_xp = inv.xp if train is None else zero
    w_xl = inv.xl if train is None and rope is None else zero
    w_pl = inv.pl if rope is None else zero
    w = ((w_x, w_xp, w_xl), (w_xp, inv.pp, w_pl), (w_xl, w_pl, w_l))
    rest = coupled.a
    if train is not None:
        rest = rest._replace(x=forces.motor * step.active.x / train.motor_mass)
    if rope is not None:
        rest = rest._replace(l=forces.winch * step.active.l / _winch_mass(plant))
    q, v = stage.q.at_drives(), stage.v.at_drives()
    loads = plant.loads(stage.q.at_load(), stage.v.at_load(), forces.drive)
    positive, negative = plant.friction_levels(stage.t, q, v, loads)
    w, rest, inv, a, positive, negative = materialise((w, rest, inv, coupled.a, positive, negative), step.go)
    return Rows(rest, w, step.v.at_drives(), positive, negative), coupled._replace(inverse=inv, a=a)


def _damped(plant: Plant, stage: Stage, step: Step, rows: Rows, damped: Sequence[str]) -> Rows:
    """The rows of drives that something parts from their axes, as means over a step with their viscous damping: it
    lessens what accelerates them, and what friction and contact do to them, by one share in a stage. Beside an impact
    late in the step this is right to order 1 in the step alone."""
    rest, w = list(rows.rest), [list(row) for row in rows.w]
    begun, now = step.v.at_drives(), stage.v.at_drives()
    for i, axis, parted in ((0, "x", plant.drive_train), (2, "l", plant.rope_end)):
        if parted is not None and axis in damped:
            rate = plant.drive_rate(axis) * w[i][i]
            first, second, _ = shares(rate * step.h)
            share = first + stage.lead * (2.0 * second - first)
            rest[i] = share * (rest[i] + rate * (getattr(now, axis) - getattr(begun, axis)))
            w[i][i] = share * w[i][i]
    return rows._replace(rest=rest, w=w)


def _contact(
    plant: Plant, stage: Stage, step: Step, forces: _Forces, coupled: _Coupled, rows: Rows, damped: Sequence[str]
) -> _Contact:
    """Dry friction, beside what stands between a drive and its side of the load."""
    train, rope = plant.drive_train, plant.rope_end
    inv, free, h, go, lead = coupled.inverse, coupled.a, step.h, step.go, stage.lead
    (w_x, _, _), (_, _, _), (_, _, w_l) = rows.w
    rest, moving = Axes(*rows.rest), Axes(*rows.moving)
    rubbing = [plant.has_friction(axis) for axis in Axes._fields]
    if isinstance(rope, HoistBacklash):
        ahead, speed = step.q.l - step.q.at_load().l, moving.l - step.v.at_load().l
        sides = Sides(ahead, speed, rest.l - free.l, (inv.xl, inv.pl, -w_l), w_l + inv.ll + _TINY)
        f, pull = through_play(rows, sides, rope.gap, rubbing, h, lead, go)
        return _Contact(f, pull=pull)
    if forces.loops:
        loops = {Axes._fields.index(axis): loop for axis, loop in forces.loops.items()}
        f, pulls = held(rows, loops, rubbing, h, lead, go)
        return _Contact([own + pulls.get(i, 0.0) for i, own in enumerate(f)])
    if train is None:
        return _Contact(friction(rows, rubbing, h, go))
    u = (-w_x, inv.xp, inv.xl if rope is None else jnp.zeros_like(inv.xl))
    apart, rate = step.q.at_drives().x - step.q.x, moving.x - step.v.x
    sides = Sides(apart, rate, rest.x - free.x, u, w_x + inv.xx + _TINY)
    if isinstance(train, Backlash):
        f, thrust = through_play(rows, sides, train.gap, rubbing, h, lead, go)
    else:
        beyond = stage.v.at_drives().x - stage.v.x
        loss = jnp.zeros_like(w_x) if "x" in damped else plant.bridge.cart_damping * w_x
        belt = Belt(train.stiffness, train.damping, loss, beyond)
        f, thrust = through_belt(rows, sides, belt, rubbing, h, lead, go)
    return _Contact(f, thrust=thrust)


def _winch_mass(plant: Plant) -> Scalar:
    """Of the winch, or of its motor alone where a play parts that from the rest."""
    rope = plant.rope_end
    return rope.motor_mass if isinstance(rope, HoistBacklash) else plant.bridge.winch_mass


def _with_hook(hook: DoublePendulum, b: Bridge, stage: Stage, inv: Symmetric, force: Axes, loaded: Scalar) -> _Coupled:
    """Adds the link below the hook: its angle enlarges the mass matrix, here by a Schur complement."""
    q, v = stage.q.at_load(), stage.v.at_load()
    phi, phi_rate = stage.q.phi, stage.v.phi
    assert phi is not None and phi_rate is not None
    mass, link = b.load_mass - hook.hook_mass, hook.link
    sine, cosine = sincos(q.psi)
    sine_phi, cosine_phi = sincos(phi)
    # cos(psi - phi) and sin(psi - phi)
    along = cosine * cosine_phi + sine * sine_phi
    across = sine * cosine_phi - cosine * sine_phi
    column = Axes(loaded * mass * link * cosine_phi, mass * link * q.l * along, mass * link * across)
    pull = mass * link * phi_rate * phi_rate
    torque = hook.damping * (phi_rate - v.psi)
    force = Axes(
        force.x + loaded * pull * sine_phi,
        force.psi + q.l * pull * (cosine * sine_phi - sine * cosine_phi) + torque,
        force.l + pull * along,
    )
    hook_x = 2.0 * v.l * v.psi * cosine - q.l * v.psi * v.psi * sine
    hook_down = -2.0 * v.l * v.psi * sine - q.l * v.psi * v.psi * cosine
    f_phi = -mass * link * (cosine_phi * hook_x - sine_phi * hook_down + b.gravity * sine_phi) - torque
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
    return _Coupled(full, a, a_phi, to_phi)
