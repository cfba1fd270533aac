"""Fits find the truth of simulated recordings, from poor starts, and larger models meet them no worse."""

import dataclasses
import time

import numpy as np
import pytest
from scipy.optimize import minimize

from jbridge.identification.data.windows import make_data
from jbridge.identification.estimation import engine_for, fit_structure, make_problem, start_of
from jbridge.identification.setting import make_setting, setting_of
from jbridge.identification.solver import Point, Start, gauss_newton
from jbridge.model.files import Model
from tests.identification.cases import (
    DRY,
    FULL,
    TIMES,
    cart_model,
    cart_recordings,
    make_recording,
    play,
    scaled,
    steps,
    values,
)
from tests.problems import EVERY_AXIS, NUMBERS, make_plant

TRUTH = make_plant(DRY)


@pytest.fixture(scope="module")
def runs():
    return cart_recordings(TRUTH, 3)


def fitted(model, runs):
    problem = make_problem(make_setting(model, runs, []), make_data(runs))
    return fit_structure(problem, model.plant, model.known)


def test_truth_is_found_from_a_poor_start(runs):
    start = scaled(cart_model(DRY), {"cart_gain": 0.5, "cart_damping": 2.0, "coulomb_friction@cart.level": 0.3})
    _, model = fitted(start, runs)
    found, true = values(model.plant), values(TRUTH)
    for name in ("cart_gain", "cart_damping", "coulomb_friction@cart.level"):
        assert found[name] == pytest.approx(true[name], rel=0.02), name  # noise, and steps of 5 ms in place of RK4's
    assert np.sqrt(np.median(model.point.square[:, 0])) < 1.3


@pytest.mark.slow
def test_optimum_is_that_of_a_general_minimiser(runs):
    """SciPy's simplex over the criterion, each window's initial state solved for at every point."""
    problem, model = fitted(cart_model(), runs[:1])
    engine, free = model.engine, model.free

    def criterion(numbers):
        vector = model.vector.copy()
        vector[free] = numbers
        start = Start(vector, free[:0], model.point.states)
        return problem.solve(engine, [start], iterations=4)[0].value

    rough = minimize(criterion, model.vector[free], method="Nelder-Mead", options={"maxfev": 60})
    assert model.point.value <= rough.fun + 0.02 * abs(rough.fun)


def test_a_larger_model_is_no_worse(runs):
    problem, small = fitted(cart_model(), runs)
    large = cart_model(("coulomb_friction", "cart", {"level": 0.0}))
    engine = engine_for(problem.setting, problem.data, large.plant)
    begun = start_of(problem, engine, large.plant, large.known)
    vector = begun.vector.copy()
    vector[: len(small.vector)] = small.vector
    [point] = problem.solve(engine, [Start(vector, begun.free, small.point.states)])
    assert point.value < small.point.value - 50.0


def test_a_long_window_begins_as_a_shorter_one_found(runs):
    """Where neither the state in hand nor the first guess serves, the state that a shorter window found does."""
    problem, model = fitted(cart_model(DRY), runs[:1])
    long = problem.windows.horizon == 3.0
    tilings = problem.data.tilings
    astray = tuple(s + 0.1 * (t.horizon == 3.0) for s, t in zip(model.point.states, tilings, strict=True))
    guesses = [
        dataclasses.replace(t, states=s) if t.horizon == 3.0 else t for t, s in zip(tilings, astray, strict=True)
    ]
    problem = dataclasses.replace(problem, data=problem.data.with_tilings(guesses))
    start = Start(model.vector, model.free, astray)
    [before] = problem.evaluate(model.engine, [start])
    [after] = problem.solve(model.engine, [start], iterations=0)
    assert before.square[long, 0].min() > 1e4
    assert np.median(after.square[long, 0]) < 4.0


def test_a_load_that_its_winch_does_not_hold_is_no_reason_to_refuse():
    """A model whose rope runs out in a free run is fitted to what short windows show."""

    true = make_plant(("coulomb_friction", "hoist", {"level": 3.0}))
    u = np.stack([steps(800, 1), 1.5 * steps(800, 2)], axis=1)
    run = play(true, u, active=EVERY_AXIS, start={"x": 0.6, "l": 0.6})
    known = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})
    _, model = fitted(Model(make_plant(), known, frozenset(NUMBERS), {}, ""), [run])
    assert np.isfinite(model.point.value)
    assert values(model.plant)["cart_gain"] == pytest.approx(values(true)["cart_gain"], rel=0.05)


def test_a_start_from_which_nothing_finite_comes_is_far_off(runs):
    problem, model = fitted(cart_model(), runs)
    start = Start(model.vector, model.free, model.point.states)
    lost = Start(model.vector, model.free, tuple(np.full_like(s, np.nan) for s in model.point.states))
    found, other = problem.solve(model.engine, [lost, start], 3)
    assert np.isfinite(found.value) and found.value > other.value


@pytest.mark.parametrize(
    ("axes", "most", "wanted"),
    [
        ("xxxxx", 3, [0, 2, 4]),
        ("xxxxx", 1, [0]),
        ("xlxlx", 3, [0, 1, 2]),  # evenly chosen recordings would show no hoist
        ("xxl", 1, [0, 2]),  # no recording alone shows both
        ("xxb", 1, [2]),
        ("xl", 3, [0, 1]),
    ],
)
def test_some_recordings_show_every_axis(axes, most, wanted):
    kept = {"x": ("u_x", "x"), "l": ("u_l", "l"), "b": ("u_x", "x", "u_l", "l")}
    each = [
        make_recording(f"{i}.csv", TIMES, **{name: FULL[name] for name in kept[axis]}) for i, axis in enumerate(axes)
    ]
    problem = make_problem(setting_of(TRUTH, each), make_data(each))
    some = problem.of_some(most)
    assert sorted({t.recording for t in some.data.tilings}) == wanted
    # A part of a part is a part.
    assert {t.recording for t in some.of_some(1).data.tilings} <= set(wanted)


@pytest.mark.parametrize(("axes", "worst", "wanted"), [("xxxxxx", 4, [0, 2, 4]), ("xxxxxl", 3, [0, 3, 5])])
def test_some_recordings_are_those_with_the_largest_error_among_others(axes, worst, wanted):
    kept = {"x": ("u_x", "x"), "l": ("u_l", "l")}
    each = [
        make_recording(f"{i}.csv", TIMES, **{name: FULL[name] for name in kept[axis]}) for i, axis in enumerate(axes)
    ]
    problem = make_problem(setting_of(TRUTH, each), make_data(each))
    square = np.where((problem.windows.recording == worst)[:, None], 100.0, 1.0) * np.ones(3)
    point = Point(np.zeros(0), np.zeros(0, np.int64), (), square, 0.0, 0.0)
    assert sorted({t.recording for t in problem.of_some(3, point).data.tilings}) == wanted


def test_steps_along_earlier_tangents_lead_to_the_same_optimum(runs, monkeypatch):
    start = scaled(cart_model(), {"cart_gain": 0.8, "cart_damping": 1.2})
    problem = make_problem(make_setting(start, runs, []), make_data(runs))
    _, model = fit_structure(problem, start.plant, start.known)
    begun, found, calls = start_of(problem, model.engine, start.plant, start.known), [], []
    sensitivities = model.engine.sensitivities
    monkeypatch.setattr(
        model.engine, "sensitivities", lambda jobs, take: (calls.append(len(jobs)), sensitivities(jobs, take))
    )
    for kept in (gauss_newton._KEPT, 0):
        calls.clear()
        monkeypatch.setattr(gauss_newton, "_KEPT", kept)
        [point] = problem.solve(model.engine, [begun], 30)
        found.append((point.value, sum(calls), point.vector[point.free]))
    (value, few, numbers), (other, many, others) = found
    assert few < many and value == pytest.approx(other, abs=0.3)
    np.testing.assert_allclose(numbers, others, rtol=5e-3)


def test_no_fit_goes_on_when_its_time_is_over(runs):
    start = scaled(cart_model(), {"cart_gain": 0.5})
    problem = make_problem(make_setting(start, runs, []), make_data(runs))
    late = dataclasses.replace(problem, until=time.monotonic())
    assert late.is_late and late.of_some(1).is_late and not problem.is_late
    _, model = fit_structure(late, start.plant, start.known)
    assert values(model.plant) == values(start.plant)
