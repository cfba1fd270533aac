"""Hand-made results as reports get them: a cart whose drive has a dead zone, with a swinging load and a hoist."""

import dataclasses
import functools
import math

import numpy as np

from jbridge.diagnosis.result import (
    Adequacy,
    Channel,
    Continued,
    Diagnosis,
    Horizon,
    Interval,
    Likeness,
    Location,
    MissingForce,
    NamedEffect,
    NextExperiment,
    NotSeen,
    Region,
    Rival,
)
from jbridge.identification.result import Errors, Estimate, Fit, Trace
from jbridge.model.bridge import Bridge
from jbridge.model.effects.drives import DeadZone
from jbridge.model.effects.friction import CoulombFriction
from jbridge.model.files import Model
from jbridge.model.plant import Plant

HOSTILE = '</script><script>document.title = "taken"</script>&.csv'
NOISE = {"x": 5e-5, "psi": 4.5e-4, "l": 6e-5}
_GAIN, _MASS, _DAMPING, _FRICTION, _DEAD = 16.0, 5.6, 45.0, 3.0, 0.30
_STEP, _DURATION = 5e-3, 12.0


def play(u_x, u_l, dead):
    """Positions and velocities of (x, psi, l), at 200 Hz: crude, but it sticks, slips and swings like a bridge."""
    state = np.array([0.4, 0.0, 0.6])
    rates = np.zeros(3)
    positions, velocities = [], []
    for voltage, hoist in zip(u_x, u_l, strict=True):
        positions.append(state.copy())
        velocities.append(rates.copy())
        for _ in range(5):
            effective = voltage - np.clip(voltage, -dead, dead)
            force = _GAIN * effective - _DAMPING * rates[0]
            step = _STEP / 5
            # Friction stops the cart within the step, or is at its level.
            friction = np.clip(force + _MASS * rates[0] / step, -_FRICTION, _FRICTION)
            a_x = (force - friction) / _MASS
            a_psi = -(9.81 * np.sin(state[1]) + a_x * np.cos(state[1])) / state[2] - 0.05 * rates[1]
            rates = rates + step * np.array([a_x, a_psi, 20.0 * (0.08 * hoist - rates[2])])
            state = state + step * rates
    return np.array(positions).T, np.array(velocities).T


def trace(name, role, seed):
    """A recording by the bridge with a dead zone, simulated without and with one."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, _DURATION, _STEP)
    u_x = np.repeat(rng.uniform(-1.2, 1.2, times.size // 160 + 1), 160)[: times.size]
    u_x += 0.5 * np.sin(2 * np.pi * 0.4 * times)
    u_l = np.repeat(rng.choice([-0.5, 0.0, 0.5], times.size // 400 + 1), 400)[: times.size]
    truth, rates = play(u_x, u_l, _DEAD)
    before, _ = play(0.86 * u_x, u_l, 0.0)
    after, _ = play(u_x, u_l, _DEAD - 0.002)
    names = ("x", "psi", "l")
    measured = {
        axis: values + NOISE[axis] * rng.standard_normal(times.size) for axis, values in zip(names, truth, strict=True)
    }
    measured["psi"][1::3] = np.nan  # a slower sensor
    lost = _GAIN * (u_x - np.clip(u_x, -_DEAD, _DEAD) - 0.86 * u_x)
    moving = np.abs(rates[0]) > 0.01
    force_before = {"x": np.where(moving, lost + 0.6 * rng.standard_normal(times.size), np.nan)}
    force_after = {"x": np.where(moving, 0.6 * rng.standard_normal(times.size), np.nan)}
    for axis, scale in (("psi", 4e-3), ("l", 0.1)):
        force_before[axis] = scale * rng.standard_normal(times.size)
        force_after[axis] = scale * rng.standard_normal(times.size)
    return Trace(
        recording=name,
        role=role,
        times=times,
        inputs={"u_x": u_x, "u_l": u_l},
        measured=measured,
        before=dict(zip(names, before, strict=True)),
        after=dict(zip(names, after, strict=True)),
        coordinates=dict(zip(names, truth, strict=True)),
        velocities=dict(zip(names, rates, strict=True)),
        force_before=force_before,
        force_after=force_after,
    )


@functools.cache
def traces():
    return (trace("train-1.csv", "train", 1), trace("train-2.csv", "train", 2), trace("holdout-1.csv", "holdout", 3))


BRIDGE = {
    "cart_mass": Estimate(5.5, None, None, None, "kg"),
    "load_mass": Estimate(0.143, None, None, None, "kg"),
    "winch_mass": Estimate(0.1, None, None, None, "kg"),
    "gravity": Estimate(9.81, None, None, None, "m/s^2"),
    "cart_damping": Estimate(45.31, 0.42, 44.49, 46.13, "N s/m"),
    "swing_damping": Estimate(0.00152, 0.00004, 0.00144, 0.0016, "N m s"),
    "hoist_damping": Estimate(24.7, 0.3, 24.1, 25.3, "N s/m"),
    "cart_gain": Estimate(16.04, 0.11, 15.82, 16.26, "N/V"),
    "hoist_gain": Estimate(2.97, math.nan, None, None, "N/V"),
}
COULOMB = NamedEffect(
    kind="coulomb_friction",
    site="cart",
    probability=None,
    parameters={"level": Estimate(3.02, 0.05, 2.92, 3.12, "N")},
    equivalents=(),
    statement="",
)
DEAD_ZONE = NamedEffect(
    kind="dead_zone",
    site="cart_drive",
    probability=0.97,
    parameters={
        "positive": Estimate(0.3012, 0.011, 0.2801, 0.3224, "V"),
        "negative": Estimate(0.2984, 0.012, 0.275, 0.322, "V"),
    },
    equivalents=(
        Rival(
            "stribeck_friction",
            "cart",
            0.021,
            {
                "level": Estimate(3.0, 0.1, 2.8, 3.2, "N"),
                "breakaway": Estimate(7.9, 0.4, 7.1, 8.7, "N"),
                "velocity": Estimate(0.021, 0.004, 0.013, 0.029, "m/s"),
            },
            {"x": 3.1e-4, "psi": 6e-4, "l": 6.1e-5},
        ),
        Rival("wrong_value", "load_mass", 0.004, {"value": Estimate(0.31, 0.02, 0.27, 0.35, "kg")}, {"x": 4.4e-3}),
    ),
    statement="The motor does nothing below about 0.30 V in either direction.",
)
KNOTS = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4]
FRICTION_MAP = NamedEffect(
    kind="position_direction_friction",
    site="cart",
    probability=0.88,
    parameters={
        "knots": Estimate(KNOTS, None, None, None, "m"),
        "positive": Estimate(
            [0.1, 0.3, 0.8, 2.1, 2.4, 1.1, 0.4, 0.2],
            [0.1] * 8,
            [0.0, 0.1, 0.6, 1.9, 2.2, 0.9, 0.2, 0.0],
            [0.3, 0.5, 1.0, 2.3, 2.6, 1.3, 0.6, 0.4],
            "N",
        ),
        "negative": Estimate(
            [0.0, 0.2, 0.5, 0.9, 1.6, 1.9, 0.8, 0.3],
            [0.1] * 7 + [math.nan],
            [0.0, 0.0, 0.3, 0.7, 1.4, 1.7, 0.6, math.nan],
            [0.2, 0.4, 0.7, 1.1, 1.8, 2.1, 1.0, math.nan],
            "N",
        ),
    },
    equivalents=(),
    statement="Dry friction of the cart is up to 2.4 N larger around x = 0.8 m than at the ends of the rail.",
)


LIKENESS = Likeness(
    0.62,
    {"x": 0.31, "x, direction": 0.4, "v_x": 0.02, "u_x": 0.0, "t": 0.0, "psi": 0.0, "v_psi": 0.62},
    0.94,
    -0.3,
    None,
    0.01,
    "The missing force reverses with the direction of motion, as friction does.",
)


def missing_force(trace):
    """A force that goes with the cart's place along a recording, not known where the cart rests."""
    times = trace.times[::2]
    return MissingForce(
        trace.recording,
        times,
        np.where(np.arange(len(times)) % 50 < 40, 0.4 * np.sin(np.arange(len(times)) / 7), np.nan),
    )


def model():
    plant = Plant(
        Bridge(cart_gain=16.04, cart_damping=45.31, hoist_gain=2.97),
        (CoulombFriction(level=3.02, site="cart"), DeadZone(positive=0.3012, negative=0.2984, site="cart_drive")),
    )
    known = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})
    return Model(plant, known, frozenset(BRIDGE), {"cart_gain": {"std": 0.11, "low": 15.82, "high": 16.26}})


def missing_physics():
    """A diagnosis with everything that one can hold."""
    return Diagnosis(
        verdict="missing_physics",
        complete=True,
        explained={"all": 0.98, "x": 0.97, "psi": 0.99},
        stopped="criterion",
        statement="The drive of the cart has a dead zone: below about 0.30 V the motor does nothing. With it the"
        " simulation meets the recordings to 1.1 times the sensors' noise.",
        adequacy=Adequacy(
            alarm=True,
            repeatable_before=0.91,
            repeatable_after=0.02,
            channels={
                "x": Channel(0.0213, 5e-5),
                "psi": Channel(0.031, 4.5e-4),
                "l": Channel(6.1e-5, 6e-5),
            },
        ),
        location=Location(
            site="cart_drive",
            equation="cart",
            sites={"cart_drive": 0.934, "cart": 0.05, "x_sensor": 0.012, "swing": 0.003, "hoist": 0.001},
            where=(Region("u_x", -0.32, 0.33, 0.71), Region("v_x", -0.05, 0.05, 0.48)),
            when=(
                Interval("train-1.csv", 3.2, 5.1),
                Interval("train-1.csv", 8.0, 8.9),
                Interval("train-2.csv", 1.0, 2.4),
            ),
        ),
        effects=(DEAD_ZONE, FRICTION_MAP),
        model_effects=(COULOMB,),
        bridge=BRIDGE,
        before=model(),
        model=model(),
        train_before=Errors({"x": 0.0213, "psi": 0.031, "l": 6.1e-5}, {"x": 0.0093, "psi": 0.022, "l": 6e-5}),
        train_after=Errors({"x": 5.5e-5, "psi": 4.7e-4, "l": 6.1e-5}, {"x": 5.1e-5, "psi": 4.6e-4, "l": 6e-5}),
        holdout_before=Errors({"x": 0.0257, "psi": 0.034, "l": 6.2e-5}, {"x": 0.0103, "psi": 0.024, "l": 6e-5}),
        holdout_after=Errors({"x": 6.5e-5, "psi": 4.9e-4, "l": 6.2e-5}, {"x": 5.3e-5, "psi": 4.7e-4, "l": 6e-5}),
        noise=NOISE,
        window=2.0,
        horizons=tuple(
            Horizon(
                seconds,
                {"x": 2e-3 * seconds**1.5, "psi": 4e-3 * seconds, "l": 6.1e-5},
                {"x": 6e-5, "psi": 4.8e-4, "l": 6.1e-5},
                {"x": 1e-3 * seconds**1.5, "psi": 2e-3 * seconds, "l": 6e-5},
                {"x": 5.5e-5, "psi": 4.6e-4, "l": 6e-5},
                None if seconds < 1 else {"x": 8e-5, "psi": 5e-4, "l": 7e-5},
            )
            for seconds in (0.1, 0.3, 1.0, 2.0, 3.0)
        ),
        holdout=("holdout-1.csv",),
        traces=traces(),
        trials=(
            {"kind": "dead_zone", "site": "cart_drive", "gain": 108.5, "price": 9.1, "accepted": True},
            {
                "kind": "stribeck_friction",
                "site": "cart",
                "gain": np.float64(6.31),
                "price": 11.0,
                "accepted": False,
            },
            {"kind": "backlash", "site": "cart", "gain": math.nan, "price": 11.0, "accepted": False},
            {"kind": "wrong_value", "site": "load_mass", "gain": 93.0, "price": None, "accepted": False},
        ),
        next_experiment=NextExperiment(
            purpose="A slow staircase of voltages between -0.6 and 0.6 V shows whether the motor or the cart's"
            " friction holds it back.",
            separates=("dead zone, cart drive", "stribeck friction, cart"),
            columns={"t": np.arange(0.0, 4.0, 0.02), "u_x": np.linspace(-0.6, 0.6, 200), "u_l": np.zeros(200)},
            expected_wrong=0.013,
            start={"x": 0.75, "psi": 0.0, "l": 0.6},
        ),
        not_seen=(
            NotSeen(
                "sensor_offset",
                "x_sensor",
                "offset",
                None,
                "m",
                None,
                True,
                "Could not have been seen: no place is known.",
            ),
            NotSeen("load_drag", "swing", "coefficient", 0.02, "N s^2/m^2", 3.1, True, "At most 0.02 N s^2/m^2."),
            NotSeen("backlash", "cart", "gap", 2.6e-5, "m", 0.4, False, "A gap of 0.026 mm or more would have shown."),
        ),
        continued=Continued(
            ("next-1.csv",),
            (
                {"kind": "dead_zone", "site": "cart_drive", "probability": 0.6},
                {"kind": "stribeck_friction", "site": "cart", "probability": 0.4},
            ),
            ({"kind": "dead_zone", "site": "cart_drive", "probability": 0.97},),
            "With next-1.csv, 1 of 2 explanations is left: dead zone at the cart drive.",
        ),
        warnings=("The swing hardly moves in train-2.csv, so a drag on the load of up to 0.02 N s²/m² may hide.",),
        notes=("train-1.csv: the sensor of psi gives a new sample about every 15 ms and repeats it in between.",),
        settings={"large": 1.5, "beam": 4, "window": 2.0, "seed": 0},
        seconds=41.7,
    )


def adequate():
    """Nothing missing; the final model is the one that was given, refitted; nobody was accused."""
    full = missing_physics()
    same = tuple(
        dataclasses.replace(trace, before=trace.after, force_before=trace.force_after) for trace in full.traces
    )
    return dataclasses.replace(
        full,
        verdict="adequate",
        statement="The model explains the recordings down to the sensors' noise; nothing needs to be added.",
        explained={},
        adequacy=Adequacy(False, None, None, {"x": Channel(5.4e-5, 5e-5), "psi": Channel(4.6e-4, 0.0)}),
        location=Location(None, "none", {}, (), ()),
        effects=(),
        train_before=full.train_after,
        holdout_before=full.holdout_after,
        traces=same,
        trials=(),
        not_seen=full.not_seen[2:],
        next_experiment=None,
        continued=None,
        warnings=(),
        notes=(),
        settings={},
    )


def unknown():
    """Something is missing without a name; some numbers are not known."""
    full = missing_physics()
    return dataclasses.replace(
        full,
        verdict="unknown",
        statement="Something acts on the cart near x = 0.8 m that no physics of the catalogue explains.",
        complete=False,
        explained={"all": -0.1, "x": -0.1},
        stopped="budget",
        location=Location(
            "cart",
            "cart",
            {"cart": 0.6, "cart_drive": 0.4},
            (Region("x", 0.6, 0.9, 0.7),),
            (),
            tuple(missing_force(trace) for trace in full.traces if trace.role == "train"),
            LIKENESS,
        ),
        effects=(),
        holdout_after=Errors({"x": 0.0042, "psi": math.nan, "l": 6e-5}, {"x": math.inf, "psi": 0.002, "l": 6e-5}),
        next_experiment=None,
    )


def cart_alone():
    """A rig with one axis only."""
    full = missing_physics()

    def only_x(trace):
        fields = ("measured", "before", "after", "coordinates", "velocities", "force_before", "force_after")
        axes = {field: {"x": getattr(trace, field)["x"]} for field in fields}
        return dataclasses.replace(trace, inputs={"u_x": trace.inputs["u_x"]}, **axes)

    errors = {
        name: Errors({"x": getattr(full, name).free_run["x"]}, {"x": getattr(full, name).window["x"]})
        for name in ("train_before", "train_after", "holdout_before", "holdout_after")
    }
    return dataclasses.replace(full, traces=tuple(map(only_x, full.traces)), noise={"x": NOISE["x"]}, **errors)


def brief(result):
    """The result with one recording, the hold-out, for the sake of quick drawing."""
    return dataclasses.replace(result, traces=result.traces[-1:])


def fitted(holdout=True):
    """A fit of the same recordings."""
    full = missing_physics()
    estimates = {
        **BRIDGE,
        "coulomb_friction@cart.level": COULOMB.parameters["level"],
        **{f"dead_zone@cart_drive.{key}": estimate for key, estimate in DEAD_ZONE.parameters.items()},
        **{f"position_direction_friction@cart.{key}": value for key, value in FRICTION_MAP.parameters.items()},
    }
    return Fit(
        model=model(),
        estimates=estimates,
        train=full.train_after,
        holdout=full.holdout_after if holdout else None,
        noise=NOISE,
        warnings=("hoist_gain cannot be told from hoist_damping: the hoist hardly moves.",),
        notes=full.notes,
        traces=full.traces,
        over_foreseen=1.2,
        window=2.0,
        seconds=7.9,
    )


def hostile():
    """A diagnosis in which every text that may come from a file is markup."""
    full, level = missing_physics(), Estimate(1.0, 0.1, 0.8, 1.2, "N")
    bad = HOSTILE
    effect = dataclasses.replace(DEAD_ZONE, kind=bad, site=bad, statement=bad, parameters={bad: level})
    return dataclasses.replace(
        full,
        statement=bad,
        location=dataclasses.replace(
            full.location,
            site=bad,
            sites={bad: 1.0},
            where=(dataclasses.replace(full.location.where[0], variable=bad),),
            when=(dataclasses.replace(full.location.when[0], recording=bad),),
        ),
        effects=(effect,),
        holdout=(bad,),
        traces=(dataclasses.replace(full.traces[0], recording=bad),),
        trials=({"kind": bad, "site": bad, bad: bad},),
        next_experiment=dataclasses.replace(full.next_experiment, purpose=bad, separates=(bad,)),
        warnings=(bad,),
        notes=(bad,),
        settings={bad: bad},
        bridge={**full.bridge, bad: dataclasses.replace(level, unit=bad)},
    )
