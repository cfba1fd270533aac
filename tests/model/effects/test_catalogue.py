"""Every effect at every site against its law in plain NumPy, and what the catalogue says of it.

The laws are run through the plant that holds all effects at once, so that a wrong sign, a wrong axis or an effect
that is present at its null values shows as well.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge._types import AXES, Axes
from jbridge.model.effects.base import AXIS_OF_SITE, SITES, AbstractFriction, AbstractHysteresis, Scene, unit_at
from jbridge.model.effects.catalogue import CATALOGUE, KINDS, make_effect
from jbridge.model.fields import options_of, parameters_of
from jbridge.model.plant import Motion
from jbridge.simulation.inputs import drive_inputs
from jbridge.simulation.measurement import readings
from jbridge.simulation.rollout import rollout
from jbridge.simulation.runge_kutta import MIDPOINT
from jbridge.simulation.state import Motions
from tests.problems import (
    NUMBERS,
    PERIOD,
    PLACES,
    Everything,
    accelerate,
    axes,
    lively_inputs,
    make_lane,
    make_plant,
    make_state,
    null_effect,
)

MECHANISMS = ("rope_elasticity", "double_pendulum", "belt_compliance", "backlash", "hoist_backlash")
"""Tested in `test_flexible`."""

SHAPE = {"knots": [0.2, 0.35, 0.6]}
EXAMPLES = {
    # what stands in a model file, with numbers that a law cannot confuse
    "coulomb_friction": {"level": 3.0},
    "stribeck_friction": {"level": 3.0, "breakaway": 5.0, "velocity": 0.3},
    "direction_dependent_friction": {"positive": 2.0, "negative": 3.5},
    "position_dependent_friction": SHAPE | {"levels": [1.0, 3.0, 2.5]},
    "position_direction_friction": SHAPE | {"positive": [1.0, 3.0, 2.5], "negative": [2.0, 0.5, 4.0]},
    "load_dependent_friction": {"level": 1.2, "share": 0.15},
    "presliding_friction": {"level": 2.0, "stiffness": 150.0},
    "quadratic_drag": {"coefficient": 7.0},
    "friction_drift": {"level": 2.0, "rate": -0.8},
    "constant_force": {"level": -1.3},
    "rail_inclination": {"knots": [0.2, 0.35, 0.6], "forces": [0.8, -0.5, 0.2]},
    "spring_force": {"stiffness": 12.0, "rest": 0.1},
    "torque_ripple": {"amplitude": 0.2, "period": 0.08, "phase": 0.9},
    "periodic_force": {"amplitude": 0.7, "period": 0.13, "phase": 0.4},
    "end_stop": {"position": 0.3, "stiffness": 400.0, "damping": 30.0},
    "load_drag": {"coefficient": 0.2},
    "wind": {"force": 0.3, "start": 1.0, "stop": 3.0},
    "length_dependent_damping": {"slope": 0.02, "length": 0.5},
    "power_law_damping": {"coefficient": 0.03, "exponent": 1.6},
    "residual_force": {
        "places": [0.2, 0.35, 0.6],
        "by_place": [0.5, -0.4, 0.1],
        "speeds": [-0.2, 0.1, 0.4],
        "by_speed": [-0.3, 0.2, 0.6],
    },
    "dead_zone": {"positive": 0.4, "negative": 0.7},
    "saturation": {"limit": 1.5},
    "force_limit": {"limit": 1.1},
    "back_emf": {"constant": 0.8},
    "freewheeling": {"constant": 0.8, "width": 0.9},
    "gain_asymmetry": {"ratio": 0.15},
    "gain_drift": {"rate": -0.02},
    "sensor_offset": {"offset": 0.012},
    "sensor_scale": {"scale": 1.03},
    "sensor_delay": {"delay": 0.0123},
    "missed_counts": {"jump": 0.02, "time": 0.253},
    "sensor_eccentricity": {"amplitude": 0.003, "period": 0.11, "phase": 0.6},
}


def interp(q, p, key):
    return np.interp(q, p["knots"], p[key])


def load_on(site, psi, w, l):
    """Size of the drives' forces at the inputs of `accelerations_of_all`, or the pull on the pivot [N]."""
    pull = NUMBERS["load_mass"] * (NUMBERS["gravity"] * np.cos(psi) + l * w**2)
    return {"cart": NUMBERS["cart_gain"] * 0.7, "swing": pull, "hoist": NUMBERS["hoist_gain"] * 0.6}[site]


def bump(q, v, p):
    return np.interp(q, p["places"], p["by_place"]) + np.interp(v, p["speeds"], p["by_speed"])


def drag_of_load(p, q, v):
    """Drag along the absolute velocity of the load, brought to the axes by the positions' derivatives."""
    s, c = np.sin(q[1]), np.cos(q[1])
    jacobian = np.array([[1.0, q[2] * c, s], [0.0, -q[2] * s, c]])
    velocity = jacobian @ v
    return jacobian.T @ (-p["coefficient"] * np.linalg.norm(velocity) * velocity)


def wind_on_load(p, t, q):
    blows = 1.0 if p["start"] < t < p["stop"] else 0.0
    return p["force"] * blows * np.array([1.0, q[2] * np.cos(q[1]), np.sin(q[1])])


def stop_force(p, q, v):
    if p.get("end", "high") == "high":
        depth, speed, away = q - p["position"], v, -1.0
    else:
        depth, speed, away = p["position"] - q, -v, 1.0
    return away * max(p["stiffness"] * depth + p["damping"] * speed, 0.0) if depth > 0 else 0.0


OWN_AXIS = {
    # force on the effect's own axis at (parameters, time, coordinate, velocity, rope length)
    "coulomb_friction": lambda p, t, q, v, l: -p["level"] * np.sign(v),
    "stribeck_friction": lambda p, t, q, v, l: (
        -(p["level"] + (p["breakaway"] - p["level"]) * np.exp(-((v / p["velocity"]) ** 2))) * np.sign(v)
    ),
    "direction_dependent_friction": lambda p, t, q, v, l: -p["positive"] if v > 0 else p["negative"],
    "position_dependent_friction": lambda p, t, q, v, l: -interp(q, p, "levels") * np.sign(v),
    "position_direction_friction": lambda p, t, q, v, l: (
        -interp(q, p, "positive") if v > 0 else interp(q, p, "negative")
    ),
    "friction_drift": lambda p, t, q, v, l: -max(p["level"] + p["rate"] * t, 0.0) * np.sign(v),
    "quadratic_drag": lambda p, t, q, v, l: -p["coefficient"] * v * abs(v),
    "constant_force": lambda p, t, q, v, l: p["level"],
    "rail_inclination": lambda p, t, q, v, l: interp(q, p, "forces"),
    "spring_force": lambda p, t, q, v, l: -p["stiffness"] * (q - p["rest"]),
    "periodic_force": lambda p, t, q, v, l: p["amplitude"] * np.sin(2 * np.pi * q / p["period"] + p["phase"]),
    "end_stop": lambda p, t, q, v, l: stop_force(p, q, v),
    "length_dependent_damping": lambda p, t, q, v, l: -p["slope"] * (l - p["length"]) * v,
    "power_law_damping": lambda p, t, q, v, l: -p["coefficient"] * abs(v) ** p["exponent"] * np.sign(v),
    "residual_force": lambda p, t, q, v, l: bump(q, v, p),
}
EVERY_AXIS = {
    # forces on the three axes at (parameters, time, coordinates, velocities)
    "load_drag": lambda p, t, q, v: drag_of_load(p, q, v),
    "wind": lambda p, t, q, v: wind_on_load(p, t, q),
}
DRIVES = {
    # input in, input out, at times
    "dead_zone": lambda p, t, u: u - np.clip(u, -p["negative"], p["positive"]),
    "saturation": lambda p, t, u: np.clip(u, -p["limit"], p["limit"]),
    "gain_asymmetry": lambda p, t, u: u * np.where(u > 0, 1 + p["ratio"], 1 - p["ratio"]),
    "gain_drift": lambda p, t, u: u * (1 + p["rate"] * t),
}
SENSORS = {
    # readings at times, of a motion given as a function of time
    "sensor_offset": lambda p, t, q: q(t) + p["offset"],
    "sensor_scale": lambda p, t, q: q(t) * p["scale"],
    "sensor_delay": lambda p, t, q: q(t - p["delay"]),
    "missed_counts": lambda p, t, q: q(t) + p["jump"] * (t > p["time"]),
    "sensor_eccentricity": lambda p, t, q: q(t) + p["amplitude"] * np.sin(2 * np.pi * q(t) / p["period"] + p["phase"]),
}
RIPPLES = ("torque_ripple",)
MOTORS = {
    # force of the drive at (parameters, its gain, input, speed)
    "force_limit": lambda p, gain, u, v: np.clip(gain * u, -p["limit"], p["limit"]),
    "back_emf": lambda p, gain, u, v: gain * (u - p["constant"] * v),
    "freewheeling": lambda p, gain, u, v: gain * (u - p["constant"] * v * min(abs(u) / p["width"], 1.0)),
}
LOADED = ("load_dependent_friction",)
BODIES = ("rod_inertia",)
"""Tested in `test_bodies`."""
WITH_MEMORY = (
    "presliding_friction",
    "cable_drag",
    "input_delay",
    "start_delay",
    "actuator_lag",
    "drum_radius_change",
    "speed_drive",
    "clock_scale",
)
"""Tested in `test_friction`, `test_rollout` and `test_speed_loop`."""


def test_every_kind_has_its_law():
    covered = [*OWN_AXIS, *EVERY_AXIS, *DRIVES, *SENSORS, *RIPPLES, *MOTORS, *LOADED, *BODIES, *WITH_MEMORY]
    covered += MECHANISMS
    assert sorted(covered) == sorted(KINDS)


def places(laws) -> list:
    return [pytest.param(kind, site, id=f"{kind}@{site}") for kind in laws for site in KINDS[kind].sites]


@functools.cache
def everything() -> Everything:
    return Everything()


STATES = np.random.default_rng(1).uniform([0.1, -1.2, 0.1, -0.6, -3, -0.6], [0.7, 1.2, 0.7, 0.6, 3, 0.6], (16, 6))
TIMES = np.random.default_rng(2).uniform(0.0, 4.0, 16)


@functools.cache
def accelerations_of_all():
    """Accelerations at `STATES` and `TIMES` for a parameter vector; z is the deflection of a presliding spring."""

    @jax.jit
    def run(vector):
        plant = everything().table.unravel(vector)

        def one(state, time):
            q, v = Motion(*state[:3]), Motion(*state[3:])
            a = accelerate(plant, q, v, axes(0.7, 0, -0.6), axes(1, 1, 1), time, jnp.asarray(0.0))
            return jnp.stack(a.axes)

        return jax.vmap(one)(jnp.asarray(STATES), jnp.asarray(TIMES))

    return lambda vector: np.array(run(jnp.asarray(vector)))


def mass_matrix(q: np.ndarray) -> np.ndarray:
    m1, m2, je = NUMBERS["cart_mass"], NUMBERS["load_mass"], NUMBERS["winch_mass"]
    s, c, l = np.sin(q[1]), np.cos(q[1]), q[2]
    return np.array([[m1 + m2, m2 * l * c, m2 * s], [m2 * l * c, m2 * l * l, 0.0], [m2 * s, 0.0, m2 + je]])


def forces_of(kind: str, site: str, values: dict) -> np.ndarray:
    """What an effect adds to the right-hand side of the equations of motion [N, N m, N], at each state."""
    run, all_of = accelerations_of_all(), everything()
    difference = run(all_of.having(kind, site, values)) - run(all_of.null)
    return np.array([mass_matrix(state[:3]) @ a for state, a in zip(STATES, difference, strict=True)])


@pytest.mark.parametrize(
    "kind, site, options",
    [*(pytest.param(*p.values, {}, id=p.id) for p in places(OWN_AXIS)), ("end_stop", "cart", {"end": "low"})],
)
def test_forces_on_their_own_axis(kind, site, options):
    values = EXAMPLES[kind] | options
    i = AXES.index(AXIS_OF_SITE[site])
    expected = np.zeros((len(STATES), 3))
    for k, (state, t) in enumerate(zip(STATES, TIMES, strict=True)):
        expected[k, i] = OWN_AXIS[kind](values, t, state[i], state[3 + i], state[2])
    # Accelerations reach 1e3 rad/s^2, of which a difference keeps about twelve digits.
    np.testing.assert_allclose(forces_of(kind, site, values), expected, rtol=1e-9, atol=1e-10)
    assert np.ptp(expected[:, i]) > 0 or kind == "constant_force"


@pytest.mark.parametrize("kind, site", places(EVERY_AXIS))
def test_forces_on_the_load(kind, site):
    """By virtual work: a force on the load acts on each axis by how that axis moves the load."""
    expected = [EVERY_AXIS[kind](EXAMPLES[kind], t, s[:3], s[3:]) for s, t in zip(STATES, TIMES, strict=True)]
    np.testing.assert_allclose(forces_of(kind, site, EXAMPLES[kind]), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("kind, site", places(RIPPLES))
def test_ripple_of_a_drive(kind, site):
    """It takes and gives a share of the drive's force, by the drive's own place."""
    p, i = EXAMPLES[kind], AXES.index(AXIS_OF_SITE[site])
    thrust = {"cart_drive": NUMBERS["cart_gain"] * 0.7, "hoist_drive": NUMBERS["hoist_gain"] * -0.6}[site]
    expected = np.zeros((len(STATES), 3))
    expected[:, i] = thrust * p["amplitude"] * np.sin(2 * np.pi * STATES[:, i] / p["period"] + p["phase"])
    np.testing.assert_allclose(forces_of(kind, site, p), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("kind, site", places(MOTORS))
def test_force_of_a_motor(kind, site):
    p, i = EXAMPLES[kind], AXES.index(AXIS_OF_SITE[site])
    gain, u = {"cart_drive": (NUMBERS["cart_gain"], 0.7), "hoist_drive": (NUMBERS["hoist_gain"], -0.6)}[site]
    expected = np.zeros((len(STATES), 3))
    expected[:, i] = [MOTORS[kind](p, gain, u, state[3 + i]) - gain * u for state in STATES]
    np.testing.assert_allclose(forces_of(kind, site, p), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("kind, site", places(LOADED))
def test_friction_by_load(kind, site):
    p, i = EXAMPLES[kind], AXES.index(AXIS_OF_SITE[site])
    expected = np.zeros((len(STATES), 3))
    for k, state in enumerate(STATES):
        load = load_on(site, state[1], state[4], state[2])
        expected[k, i] = -(p["level"] + p["share"] * load) * np.sign(state[3 + i])
    np.testing.assert_allclose(forces_of(kind, site, p), expected, rtol=1e-9, atol=1e-10)


def test_virtual_work_of_the_wind():
    """The work of a horizontal force over any displacement is the force times the load's way."""
    step = 1e-6

    def across(q):
        return q[0] + q[2] * np.sin(q[1])

    for state in STATES:
        q = state[:3]
        slope = [(across(q + d) - across(q - d)) / (2 * step) for d in step * np.eye(3)]
        np.testing.assert_allclose(wind_on_load({"force": 1.0, "start": 0.0, "stop": 2.0}, 1.0, q), slope, atol=1e-9)


def test_an_end_stop_never_pulls():
    """Leaving fast, the damper would hold the cart back; a stop that is not glued on lets go."""
    for end, sign in (("high", -1.0), ("low", 1.0)):
        effect = make_effect("end_stop", "cart", EXAMPLES["end_stop"] | {"end": end, "damping": 300.0})
        for x in np.linspace(0.0, 0.6, 13):
            for speed in (-2.0, 0.0, 2.0):
                force = effect.force(jnp.asarray(0.0), axes(x, 0, 0.7), axes(speed, 0, 0))
                assert sign * float(force.x) >= 0.0 and force.psi == 0.0 and force.l == 0.0


@pytest.mark.parametrize("kind, site", places(DRIVES))
def test_drives(kind, site):
    all_of, column = everything(), 0 if AXIS_OF_SITE[site] == "x" else 1
    u = np.random.default_rng(3).uniform(-3, 3, (40, 2))
    u[::7] = 0.0
    lane = make_lane(u, start=2.0)
    vector = all_of.having(kind, site, EXAMPLES[kind])
    ours = np.array(drives_of_all()(jnp.asarray(vector), lane))
    expected = u.copy()
    expected[:, column] = DRIVES[kind](EXAMPLES[kind], 2.0 + (np.arange(40) + 0.5) * PERIOD, u[:, column])
    np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-12)


@functools.cache
def drives_of_all():
    return jax.jit(lambda vector, lane: drive_inputs(everything().table.unravel(vector), lane).mean[:, 0])


@functools.cache
def readings_of_all():
    return jax.jit(lambda vector, lane, motions: readings(everything().table.unravel(vector), lane, motions))


CUBICS = {"x": [0.2, 0.3, -0.4, 0.5], "psi": [0.1, -0.6, 0.9, 0.3], "l": [0.6, 0.1, 0.2, -0.3]}
"""Motions that interpolation by cubics gives back exactly."""


@pytest.mark.parametrize("kind, site", places(SENSORS))
def test_sensors(kind, site):
    all_of, axis = everything(), AXIS_OF_SITE[site]
    # An irregular grid: what is late must be looked up in time, not counted in samples.
    dt = np.random.default_rng(4).uniform(0.004, 0.006, 80)
    start = 0.1
    t = start + np.concatenate([[0.0], np.cumsum(dt)])
    polynomials = {name: np.polynomial.Polynomial(c) for name, c in CUBICS.items()}
    q = Motion(*(jnp.asarray(polynomials[name](t - start)) for name in AXES))
    v = Motion(*(jnp.asarray(polynomials[name].deriv()(t - start)) for name in AXES))
    motions = Motions(q, v, axes(0, 0, 0), jnp.zeros(len(t)))
    vector = all_of.having(kind, site, EXAMPLES[kind])
    ours = np.array(readings_of_all()(jnp.asarray(vector), make_lane(np.zeros((80, 2)), dt, start=start), motions))
    expected = np.stack([polynomials[name](t - start) for name in AXES], axis=1)
    expected[:, AXES.index(axis)] = SENSORS[kind](EXAMPLES[kind], t, lambda t: polynomials[axis](t - start))
    # Before the first sample the motion is continued as a straight line, which the delay's law does not know;
    # the jump's rise takes one sample.
    known = np.ones(len(t), bool)
    if kind == "sensor_delay":
        known = t - EXAMPLES[kind]["delay"] >= start
    if kind == "missed_counts":
        known = np.abs(t - EXAMPLES[kind]["time"]) > 0.51 * np.mean(dt)
    assert known.sum() > 70
    np.testing.assert_allclose(ours[known], expected[known], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("kind", [kind for kind in SENSORS if kind != "sensor_delay"])
def test_a_sensor_reads_a_single_sample(kind):
    sensor = make_effect(kind, "x_sensor", EXAMPLES[kind])
    reading = sensor.read(jnp.array([0.3]), jnp.array([0.5]), jnp.array([0.5]))
    assert np.isfinite(np.array(reading)).all()


def test_all_effects_at_null_are_none():
    """The plant with every effect at null moves and reads like the bare bridge."""
    lane, start = make_lane(lively_inputs(100)), make_state(psi=0.2, rates=(0.1, 0.5, -0.2))

    @jax.jit
    def run(plant):
        return readings(plant, lane, rollout(plant, start, lane, substeps=1, method=MIDPOINT))

    all_of = everything()
    np.testing.assert_allclose(run(all_of.table.unravel(jnp.asarray(all_of.null))), run(make_plant()), atol=1e-13)


def felt(effect, q, v, z) -> list[float]:
    """Forces of an effect on its own axis, and where its hidden spring goes, at a place with a speed."""
    now, load, axis = jnp.asarray(1.3), jnp.asarray(4.0), AXIS_OF_SITE[effect.site]
    if isinstance(effect, AbstractHysteresis):
        # Without a force the spring does not matter.
        after = [float(effect.deflection(z, way)) for way in (0.01 * v, -0.03 * v)] if effect.level > 0 else [0.0, 0.0]
        return [float(effect.force(q, z)), *after]
    if isinstance(effect, AbstractFriction):
        return [float(level) for level in effect.levels(now, q, v, load)]
    places = Axes(*(q if name == axis else jnp.asarray(0.7) for name in AXES))
    rates = Axes(*(v if name == axis else jnp.asarray(0.2) for name in AXES))
    return [float(getattr(effect.force(now, places, rates), axis)), 0.0, 0.0]


CONTAINED = [
    pytest.param(cls.kind, part, site, id=f"{cls.kind}>{part.kind}@{site}")
    for cls in CATALOGUE.values()
    for part in cls.contains
    for site in cls.sites
    if not site.endswith("_drive")  # tested in `test_speed_loop`
]


@pytest.mark.parametrize("kind, part, site", CONTAINED)
def test_a_law_becomes_what_it_contains(kind, part, site):
    simple = EXAMPLES[part.kind]
    if kind == "position_dependent_friction" and part.kind == "direction_dependent_friction":
        simple = {"positive": 2.0, "negative": 2.0}  # of which a map has but those with one level
    effect = null_effect(kind, site)
    infos = parameters_of(type(effect))
    values = {key: np.array(getattr(effect, info.name)) for key, info in infos.items()}
    values |= {key: np.broadcast_to(value, values[key].shape) for key, value in part.same(simple, values).items()}
    for q, v, z in ((0.3, 0.4, 0.2), (0.55, -0.1, -0.6)):
        at = jnp.asarray(q), jnp.asarray(v), jnp.asarray(z)
        own, theirs = felt(make_effect(kind, site, values), *at), felt(make_effect(part.kind, site, simple), *at)
        np.testing.assert_allclose(own, theirs, rtol=1e-12)
    assert dict(part.simpler(values)) == pytest.approx(simple)


SCENE = Scene(
    low={"x": 0.1, "psi": -0.3, "l": 0.4, "u_x": -2.0, "u_l": -3.0},
    high={"x": 1.1, "psi": 0.3, "l": 0.9, "u_x": 2.5, "u_l": 3.0},
    speed={"x": 0.4, "psi": 1.0, "l": 0.2},
    acceleration={"x": 1.5, "psi": 9.0, "l": 0.8},
    recorded=((0.0, 12.0), (30.0, 38.0)),
    runs=((100.0, 112.0), (230.0, 238.0)),
    period=PERIOD,
    length=0.65,
    bridge=NUMBERS,
    friction={"cart": 3.0, "swing": 0.0, "hoist": 0.0},
)


@pytest.mark.parametrize("kind, site", places(KINDS))
def test_seeds_name_parameters_and_keep_bounds(kind, site):
    cls = CATALOGUE.get(kind, KINDS[kind])
    infos, options = parameters_of(cls), options_of(cls)
    seeds = cls.seeds(site, SCENE)
    # Where x is 0 is a matter of choice.
    assert seeds or (kind, site) == ("sensor_offset", "x_sensor")
    for seed in seeds:
        assert set(seed.free) <= {key for key, info in infos.items() if info.fitted}
        # A presliding spring takes the plain friction's place, which its seed may set.
        assert set(seed.values) <= {*infos, *options, "coulomb"}
        for key, info in infos.items():
            if key in seed.values:
                assert np.all(info.low <= np.asarray(seed.values[key])), key
                assert np.all(np.asarray(seed.values[key]) <= info.high), key


@pytest.mark.parametrize("kind, site", places(KINDS))
def test_units_are_filled_in(kind, site):
    for info in parameters_of(KINDS[kind]).values():
        unit = unit_at(info.unit, site, {"u_x": "count"})
        assert unit and "{" not in unit
        assert info.low <= info.null <= info.high or np.isnan(info.null)


def test_a_wrong_site_is_refused():
    assert {site for cls in KINDS.values() for site in cls.sites} == set(SITES)
    for kind, cls in KINDS.items():
        wrong = next(site for site in SITES if site not in cls.sites)
        with pytest.raises(ValueError, match=f"{kind} cannot be at site '{wrong}'"):
            null_effect(kind, wrong)
    assert len(PLACES) == len(set(PLACES))
