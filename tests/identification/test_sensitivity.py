"""Windows simulated through a recording against rollouts of their own, and tangents against central differences."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import engine_for, make_problem, start_of
from jbridge.identification.sensitivity import engine as module
from jbridge.identification.sensitivity.engine import Job
from jbridge.identification.sensitivity.windowed_rollout import BLOCK, Stepping, Steps, tangents
from jbridge.identification.setting import make_setting
from jbridge.identification.solver import variable_projection
from jbridge.model.files import Model
from jbridge.simulation.runge_kutta import MIDPOINT, RK4
from tests.identification.cases import play, steps
from tests.problems import EVERY_AXIS, NUMBERS, make_lane, make_plant, measure, simulate

DRY = make_plant(
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("coulomb_friction", "hoist", {"level": 2.0}),
    ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.25}),
    ("sensor_offset", "psi_sensor", {"offset": 0.01}),
    ("sensor_scale", "l_sensor", {"scale": 1.03}),
    swing_damping=0.01,
)


def problem_of(plant, horizons):
    inputs = [np.stack([steps(150, i), 0.7 * steps(150, 5 + i) - 0.3], axis=1) for i in range(2)]
    runs = [
        play(plant, u, name=f"{i}.csv", active=EVERY_AXIS, start={"x": 0.6, "psi": 0.1}, seed=i)
        for i, u in enumerate(inputs)
    ]
    model = Model(plant, frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"}), frozenset(NUMBERS), {}, "")
    problem = make_problem(make_setting(model, runs, []), make_data(runs, horizons))
    engine = engine_for(problem.setting, problem.data, plant)
    return problem, engine, start_of(problem, engine, plant, model.known), inputs


def test_windows_are_rollouts_of_their_own():
    plant = make_plant(("coulomb_friction", "cart", {"level": 3.0}), swing_damping=0.01)
    problem, engine, start, inputs = problem_of(plant, (0.3,))
    number = engine.steps.predictions.number
    for tiling in problem.data.tilings:
        [predicted] = engine.predict([Job(start.vector, tiling.recording, tiling.begins, tiling.states)])
        for begin, stop, state in zip(tiling.begins, tiling.stops, tiling.states, strict=True):
            lane = make_lane(inputs[tiling.recording][begin : stop - 1], 0.01, active=EVERY_AXIS)
            own = measure(
                plant,
                lane,
                simulate(plant, jnp.asarray(state), lane, substeps=number, method=MIDPOINT),
            )
            # The same steps in another order of operations.
            assert np.abs(predicted[begin:stop] - own).max() < 1e-9


@pytest.mark.parametrize(
    "between",
    [
        (),
        pytest.param(("belt_compliance", {"stiffness": 2e4}), marks=pytest.mark.slow),
        ("backlash", {"gap": 0.002}),
    ],
)
def test_stiff_damping_asks_for_no_more_steps(between):
    """A cart that takes its speed in 3 ms, against steps so short that its damping is not stiff."""
    stiff = {"cart_damping": 1650.0, "cart_gain": 580.0, "swing_damping": 0.01}
    friction = ("coulomb_friction", "cart", {"level": 3.0})
    parted = [(between[0], "cart", {"motor_mass": 1.5, **between[1]})] if between else []
    problem, engine, start, _ = problem_of(make_plant(friction, *parted, **stiff), (WHOLE,))
    soft = engine_for(problem.setting, problem.data, make_plant(friction, *parted, swing_damping=0.01))
    for own, plain in zip(engine.steps, soft.steps, strict=True):
        assert own.damped == ("x",) and own.number == plain.number
    job = Job(start.vector, 0, problem.data.tilings[0].begins, problem.data.tilings[0].states)
    [found] = engine.predict([job])
    engine.steps = Stepping(Steps(64, fine=True), engine.steps.tangents)
    [wanted] = engine.predict([job])
    apart = np.abs(found - wanted)[: problem.data.grids[0].intervals + 1].max(axis=0)
    assert (apart < 2.5e-3 * np.ptp(wanted, axis=0)).all(), apart


def test_a_shift_moves_what_is_simulated():
    plant = make_plant(("coulomb_friction", "cart", {"level": 3.0}), swing_damping=0.01)
    problem, engine, start, inputs = problem_of(plant, (WHOLE,))
    number = engine.steps.predictions.number
    tiling, at = problem.data.tilings[0], 70
    job = Job(start.vector, 0, tiling.begins, tiling.states)
    shift = np.array([0.02, 0.03, -0.01, 0.1, -0.2, 0.05])
    [plain, shifted] = engine.predict([job, job._replace(shifted=np.array([at]), shifts=shift[None])])
    np.testing.assert_array_equal(shifted[:at], plain[:at])
    np.testing.assert_allclose(shifted[at] - plain[at], shift[:3], atol=1e-12)
    # From there it is a simulation of its own.
    lane = make_lane(inputs[0][:at], 0.01, active=EVERY_AXIS)
    moved = simulate(plant, jnp.asarray(tiling.states[0]), lane, substeps=number, method=MIDPOINT)
    there = np.array([np.asarray(part)[-1] for part in (*moved.q.axes, *moved.v.axes)]) + shift
    after = make_lane(inputs[0][at : at + 60], 0.01, active=EVERY_AXIS)
    own = simulate(plant, jnp.asarray(there), after, substeps=number, method=MIDPOINT)
    assert np.abs(shifted[at : at + 61] - measure(plant, after, own)).max() < 1e-9


def test_a_shift_is_one_of_readings():
    """A sensor's scale and offset are those of what it reads, however far the coordinate has to move for it."""
    scales = [("sensor_scale", "x_sensor", {"scale": 2.0}), ("sensor_scale", "psi_sensor", {"scale": 0.8})]
    plant = make_plant(*scales, ("sensor_offset", "x_sensor", {"offset": 0.3}), swing_damping=0.01)
    problem, engine, start, _ = problem_of(plant, (WHOLE,))
    tiling, at = problem.data.tilings[0], 70
    shift = np.array([0.02, 0.03, -0.01, 0.1, -0.2, 0.05])
    job = Job(start.vector, 0, tiling.begins, tiling.states)
    [plain, shifted] = engine.predict([job, job._replace(shifted=np.array([at]), shifts=shift[None])])
    np.testing.assert_allclose(shifted[at] - plain[at], shift[:3], atol=1e-12)


@pytest.mark.parametrize("delay", [0.0013, 0.0092, 0.0468])
def test_an_input_late_by_a_part_of_a_step_is_as_exact_as_one_that_is_not(delay):
    """Against steps that are cut where the input changes, so short that dead zone and friction leave no error."""
    friction = [("coulomb_friction", "cart", {"level": 3.0}), ("dead_zone", "cart_drive", {"positive": 0.3})]
    errors = []
    for late in (0.0, delay):
        plant = make_plant(*friction, ("input_delay", "cart_drive", {"delay": late}), swing_damping=0.01)
        problem, engine, start, inputs = problem_of(plant, (WHOLE,))
        tiling, count = problem.data.tilings[0], problem.data.grids[0].intervals
        [predicted] = engine.predict([Job(start.vector, 0, tiling.begins, tiling.states)])
        lane = make_lane(inputs[0][:count], 0.01, active=EVERY_AXIS)
        moved = simulate(plant, jnp.asarray(tiling.states[0]), lane, substeps=32, method=RK4)
        errors.append(np.abs(predicted[: count + 1] - measure(plant, lane, moved)).max(axis=0))
    assert (errors[1] < 2.0 * errors[0] + 1e-9).all(), errors


def test_late_readings_and_inputs_reach_back_over_blocks():
    late = [("sensor_delay", f"{axis}_sensor", {"delay": delay}) for axis, delay in (("x", 0.9), ("psi", 0.035))]
    plant = make_plant(*late, ("input_delay", "cart_drive", {"delay": 0.8}), swing_damping=0.01)
    problem, engine, start, inputs = problem_of(plant, (WHOLE,))
    number = engine.steps.predictions.number
    tiling = problem.data.tilings[0]
    # From rest, where what a late sensor reads is what there is.
    rest = np.concatenate([tiling.states[:1, :3], np.zeros((1, 3))], axis=1)
    [predicted] = engine.predict([Job(start.vector, 0, tiling.begins, rest)])
    count = problem.data.grids[0].intervals
    assert count > 2 * BLOCK and engine.samples % BLOCK != 0
    lane = make_lane(inputs[0][:count], 0.01, active=EVERY_AXIS)
    moved = simulate(plant, jnp.asarray(rest[0]), lane, substeps=number, method=MIDPOINT)
    assert np.abs(predicted[: count + 1] - measure(plant, lane, moved)).max() < 1e-9


@pytest.mark.parametrize("horizon", [0.3, WHOLE])
def test_tangents_against_central_differences(horizon):
    problem, engine, start, _ = problem_of(DRY, (horizon,))
    # Of the same steps as the predictions whose derivatives they are.
    engine.steps = Stepping(engine.steps.tangents, engine.steps.tangents)
    tiling = problem.data.tilings[0]
    # From rest, where friction has a kink, no difference is a derivative.
    states = tiling.states + np.array([0.0, 0.0, 0.0, 0.3, 0.2, 0.1])
    found = {}
    job = Job(start.vector, 0, tiling.begins, states, start.free)
    engine.sensitivities([job], lambda i, told: found.setdefault(i, told))
    engine.by_differences().sensitivities([job], lambda i, told: found.setdefault("differences", told))
    ours, theirs = found[0].tangents, found["differences"].tangents
    end = problem.data.grids[0].intervals + 1
    jobs = []
    for place in start.free:
        for sign in (1.0, -1.0):
            moved = start.vector.copy()
            moved[place] += sign * 1e-5 * max(abs(moved[place]), 0.1)
            jobs.append(Job(moved, 0, tiling.begins, states))
    for k in range(6):
        for sign in (1.0, -1.0):
            jobs.append(Job(start.vector, 0, tiling.begins, states + sign * 1e-6 * np.eye(6)[k]))
    runs = engine.predict(jobs)
    sizes = [*(1e-5 * np.maximum(np.abs(start.vector[start.free]), 0.1)), *[1e-6] * 6]
    for column, size in enumerate(sizes):
        wanted = (runs[2 * column] - runs[2 * column + 1])[:end] / (2 * size)
        # Stops and reversals move with the parameters, and a step of the difference crosses some of them.
        tolerance = 2e-2 * max(np.abs(wanted).max(), 1e-6)
        assert np.abs(ours[column][:end] - wanted).max() <= tolerance, column
        # Of one side, so that a stop that the step crosses weighs twice.
        assert np.abs(theirs[column][:end] - wanted).max() <= 2 * tolerance, column


@pytest.mark.slow
def test_what_is_absent_may_stand_in_the_program():
    problem, own, start, _ = problem_of(DRY, (0.3,))
    wide = make_plant(
        *((e.kind, e.site, {k: v for k, v in vars(e).items() if k != "site"}) for e in DRY.effects),
        ("quadratic_drag", "cart", {"coefficient": 0.0}),
        ("stribeck_friction", "cart", {"level": 0.0, "breakaway": 0.0, "velocity": 0.05}),
        ("input_delay", "hoist_drive", {"delay": 0.0}),
        ("sensor_delay", "x_sensor", {"delay": 0.0}),
        ("sensor_eccentricity", "psi_sensor", {"amplitude": 0.0, "period": 0.1, "phase": 0.0}),
        swing_damping=0.01,
    )
    some = engine_for(problem.setting, problem.data, wide, len(DRY.effects), width=9)
    every = engine_for(problem.setting, problem.data, wide)
    tiling = problem.data.tilings[0]
    vector = np.array(some.table.ravel(wide), dtype=float)
    names = [own.table.entry(int(place)).name for place in start.free]
    both = [*names, "quadratic_drag@cart.coefficient", "input_delay@hoist_drive.delay", "sensor_delay@x_sensor.delay"]
    found, predicted = {}, {}
    for key, engine, at, free in (
        ("own", own, start.vector, names),
        ("lean", some, vector, names),
        ("drag", some, vector, both),
        ("all", every, vector, both),
        ("turned", some, vector, both[::-1]),
    ):
        places = np.array([engine.table.positions(name)[0] for name in free])
        job = Job(at, 0, tiling.begins, tiling.states, places)
        engine.sensitivities([job], lambda i, t, k=key: found.update({k: t}))
        [predicted[key]] = engine.predict([job])
    for one, other in (("lean", "own"), ("drag", "all")):
        assert np.allclose(predicted[one], predicted[other], rtol=0, atol=1e-10)
        assert np.allclose(found[one].tangents, found[other].tangents, rtol=1e-6, atol=1e-9)
    # More columns than a call takes, in another order.
    assert np.allclose(found["turned"].tangents[len(both) - 1 :: -1], found["drag"].tangents[: len(both)], atol=1e-12)


def test_what_happens_in_one_recording_happens_at_its_moment_there_and_in_no_other():
    step = ("missed_counts", "x_sensor", {"jump": 0.01, "time": 0.5})
    problem, engine, start, _ = problem_of(make_plant(step), (WHOLE,))
    [jump], [time] = (engine.table.positions(f"missed_counts@x_sensor.{key}") for key in ("jump", "time"))
    without = start.vector.copy()
    without[jump] = 0.0
    # In both of them half a second after the start, or so long after that of the first, or the second; or before it.
    for alone, after in ((None, 0.5), (0, 0.5), (1, 0.8), (1, -0.1)):
        vector = start.vector.copy()
        vector[time] = after + (0.0 if alone is None else problem.setting.starts(problem.setting.recordings[alone]))
        where, told = problem.setting.when(vector[time])
        assert (where and where.name) == (None if alone is None else f"{alone}.csv") and told == pytest.approx(after)
        jobs = [Job(v, t.recording, t.begins, t.states) for t in problem.data.tilings for v in (vector, without)]
        readings = engine.predict(jobs)
        times = problem.data.grids[0].times
        for own, (one, other) in enumerate(zip(readings[::2], readings[1::2], strict=True)):
            stepped = (times > after + 0.01) & (alone in (None, own))
            still = times < after - 0.01
            change = (one - other)[: len(times), 0]
            # The state at the beginning is that of the reading, which had not stepped yet.
            np.testing.assert_allclose(change[stepped], 0.01 if after > 0.0 else 0.0, atol=1e-9)
            np.testing.assert_allclose(change[still | (alone not in (None, own))], 0.0, atol=1e-9)


def of_two_horizons():
    """Both recordings in short windows and whole, with tangents four columns a call."""
    problem, _, start, _ = problem_of(DRY, (0.3, WHOLE))
    return problem, engine_for(problem.setting, problem.data, DRY, width=4), start


@pytest.mark.slow
def test_long_recordings_are_taken_one_by_one(monkeypatch):
    """All of its columns, before those of the next: other calls, the same tangents, in memory for one recording."""
    problem, engine, start = of_two_horizons()
    jobs = [Job(start.vector, t.recording, t.begins, t.states, start.free) for t in problem.data.tilings]
    assert len(start.free) > engine.width and len(jobs) == 4
    found, calls = {}, []

    def counted(table, lanes, *more):
        calls.append(len(lanes.vectors))
        return tangents(table, lanes, *more)

    usual = module._CALL
    for room in (usual, 1):
        monkeypatch.setattr(module, "_CALL", room)
        monkeypatch.setattr(module, "_HELD", room)
        told = found.setdefault(room, {})
        monkeypatch.setattr(module, "tangents", counted)
        engine.sensitivities(jobs, told.__setitem__)
    parts = -(-len(start.free) // engine.width)
    assert calls.count(1) == 4 * parts and max(calls) > 1
    few, many = found[1], found[usual]
    assert list(few) == [0, 1, 2, 3]
    for number, one in few.items():
        np.testing.assert_allclose(one.tangents, many[number].tangents, rtol=1e-9, atol=1e-12)


def test_windows_are_taken_some_at_a_time(monkeypatch):
    """Each has products of its own, so nothing depends on how many are taken together."""
    problem, engine, start = of_two_horizons()
    points = problem.evaluate(engine, [start])
    [together] = problem.normal(engine, points)
    monkeypatch.setattr(variable_projection, "_ABREAST", 3)
    [apart] = problem.normal(engine, points)
    assert max(tiling.windows for tiling in problem.data.tilings) > 3 and np.any(together.back)
    for one, other in zip(dataclasses.astuple(together), dataclasses.astuple(apart), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_simulation_that_runs_away_is_far_off_and_finite():
    plant = make_plant(hoist_gain=3.0)
    problem, engine, start, _ = problem_of(plant, (WHOLE,))
    lost = start.vector.copy()
    lost[engine.table.positions("hoist_gain")] = 1e6
    [predicted] = engine.predict([Job(lost, 0, problem.data.tilings[0].begins, problem.data.tilings[0].states)])
    assert np.isfinite(predicted).all()
