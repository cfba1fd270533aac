"""Wide free swings of a short pendulum before a fine encoder: a step that makes them too slow would get a name.

Recordings are played by SciPy, on the equation of a pendulum written down here.
"""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge import diagnose
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import make_recording
from tests.problems import make_plant

MASS, LENGTH, GRAVITY = 0.143, 0.153, 9.81
PERIOD, NOISE = 0.008, 1.5e-4
LEVEL, DRAG = 5e-4, 4e-3
MODEL = Model(
    make_plant(load_mass=MASS, swing_damping=2e-4),
    frozenset({"load_mass", "gravity"}),
    frozenset({"load_mass", "gravity", "swing_damping"}),
    {},
    "swing.toml",
)


def swing(name, start, seed, *, level=0.0, drag=0.0, damping=1e-4, count=1100):
    """A pendulum let go at an angle [rad], with viscous, dry and air drag."""

    def course(t, state):
        psi, rate = state
        torque = damping * rate + drag * LENGTH**3 * abs(rate) * rate + level * np.tanh(rate / 1e-3)
        return [rate, -GRAVITY / LENGTH * np.sin(psi) - torque / (MASS * LENGTH**2)]

    times = np.arange(count) * PERIOD
    run = solve_ivp(
        course, (0.0, times[-1]), [start, 0.0], t_eval=times, method="LSODA", rtol=1e-9, atol=1e-11, max_step=0.01
    )
    psi = run.y[0] + NOISE * np.random.default_rng(seed).standard_normal(len(times))
    return dataclasses.replace(make_recording(name, times, psi=psi), locked_length=LENGTH)


def diagnosed(**missing):
    runs = [swing(f"run-{i}.csv", start, i, **missing) for i, start in enumerate([2.0, 1.9, 1.7, 1.8, 0.1])]
    return diagnose(MODEL, runs, [swing("proof-1.csv", 1.85, 8, **missing), swing("proof-2.csv", 0.2, 9, **missing)])


@pytest.mark.slow
def test_wide_swings_ask_for_steps_of_order_4():
    runs = [swing(f"run-{i}.csv", start, i, count=4400) for i, start in enumerate([2.0, 1.9])]
    setting = make_setting(MODEL, runs, [])
    assert setting.fine and not make_setting(MODEL, [swing("small.csv", 0.02, 5)], []).fine
    ratios = []
    for fine in (True, False):
        problem = make_problem(dataclasses.replace(setting, fine=fine), make_data(runs, (1.0, WHOLE)))
        problem, fitted = fit_structure(problem, MODEL.plant, MODEL.known)
        ratios.append(float(np.sqrt(fitted.point.square[np.isinf(problem.windows.horizon), 1].mean())))
    # The midpoint method's own error is a quarter of the noise, which a thousand samples tell.
    assert ratios[0] == pytest.approx(1.0, abs=0.06) and ratios[1] ** 2 - ratios[0] ** 2 > 0.2**2


@pytest.mark.slow
def test_a_wrong_damping_alone_raises_no_alarm():
    found = diagnosed()
    assert found.verdict == "adequate" and not found.effects, found.statement


@pytest.mark.slow
def test_dry_friction_and_air_drag_are_told_apart_and_nothing_else_is_named():
    found = diagnosed(level=LEVEL, drag=DRAG)
    assert found.verdict == "missing_physics", found.statement
    numbers = {(e.kind, e.site): [p.value for p in e.parameters.values()] for e in found.effects}
    assert numbers == {
        ("coulomb_friction", "swing"): pytest.approx([LEVEL], rel=0.01),
        ("load_drag", "swing"): pytest.approx([DRAG], rel=0.01),
    }
