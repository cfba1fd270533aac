"""The concealed proof: its rig against an independent integration, its seals, its scorer."""

import importlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge.model.effects.catalogue import CATALOGUE

pytest.importorskip("mujoco")
HERE = Path(__file__).parents[2] / "experiments" / "concealed"
sys.path.insert(0, str(HERE))  # the scripts of an experiment import their neighbours by plain names

cases, kinds, play, rig, scoring, seal, sensors, tables = (
    importlib.import_module(name) for name in ("cases", "kinds", "play", "rig", "score", "seal", "sensors", "tables")
)
score, parameter_errors = scoring.score, scoring.parameter_errors

BRIDGE = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 50.0,
    "swing_damping": 0.0015, "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip
START = {"x": 0.75, "psi": 0.1, "l": 0.7}


def plain(effects=(), **more):
    return {"bridge": BRIDGE, "effects": list(effects), "parts": "full", "rope": "winch"} | more


def volts(seconds: float) -> np.ndarray:
    t = np.arange(round(seconds / rig.SAMPLE) + 1) * rig.SAMPLE
    cart = 2 * np.sin(1.7 * t) + np.where(np.floor(t) % 2, 1.0, -1.0)
    return np.column_stack([cart, -0.45 + 0.8 * np.sin(1.1 * t)])


def rates(t, y, u_x, u_l):
    """The three coupled equations, solved by a general linear solver."""
    _, psi, l, dx, dpsi, dl = y
    m1, m2, winch, g = (BRIDGE[k] for k in ("cart_mass", "load_mass", "winch_mass", "gravity"))
    s, c = math.sin(psi), math.cos(psi)
    mass = [[m1 + m2, m2 * l * c, m2 * s], [m2 * l * c, m2 * l**2, 0.0], [m2 * s, 0.0, m2 + winch]]
    force = [
        BRIDGE["cart_gain"] * u_x - BRIDGE["cart_damping"] * dx - 2 * m2 * dl * dpsi * c + m2 * l * dpsi**2 * s,
        -BRIDGE["swing_damping"] * dpsi - 2 * m2 * l * dl * dpsi - m2 * g * l * s,
        BRIDGE["hoist_gain"] * u_l - BRIDGE["hoist_damping"] * dl + m2 * l * dpsi**2 + m2 * g * c,
    ]
    return np.concatenate([y[3:], np.linalg.solve(mass, force)])


def integrated(u: np.ndarray, rule=rates) -> np.ndarray:
    y = np.array([START["x"], START["psi"], START["l"], 0.0, 0.0, 0.0])
    rows = [y]
    for row in u[:-1]:
        y = solve_ivp(rule, (0, rig.SAMPLE), y, args=tuple(row), rtol=1e-9, atol=1e-11).y[:, -1]
        rows.append(y)
    return np.array(rows)


def test_plain_rig_agrees_with_the_equations():
    u = volts(2.0)
    run = rig.simulate(plain(), u, 2.0, 0, START, noisy=False)
    true = integrated(u)
    # The step of 0.2 ms leaves 0.3 um and 0.02 mrad; encoders resolve 100 um and 1.5 mrad.
    for i, (channel, tolerance) in enumerate((("x", 2e-6), ("psi", 5e-5), ("l", 1e-5))):
        np.testing.assert_allclose(run[channel], true[:, i], atol=tolerance, rtol=0)


def test_the_oracle_agrees_with_the_equations():
    oracle = pytest.importorskip("tests.oracles.mujoco_bridge")
    u = volts(1.0)
    forces = np.column_stack([BRIDGE["cart_gain"] * u[:-1, 0], 0 * u[:-1, 0], BRIDGE["hoist_gain"] * u[:-1, 1]])
    rows = oracle.trajectory(BRIDGE, [*START.values(), 0.0, 0.0, 0.0], forces, rig.SAMPLE)
    np.testing.assert_allclose(rows, integrated(u), atol=1e-6, rtol=0)


def test_stuck_is_stuck():
    """Friction above the load's weight holds the rope, but for creep of a hundredth of a count."""
    friction = [{"kind": "coulomb_friction", "site": "hoist", "level": 3.0}]
    run = rig.simulate(plain(friction), np.zeros((1, 2)), 2.0, 0, START, noisy=False)
    assert np.ptp(run["l"]) < 1e-6


def test_a_push_ends_where_coulomb_says():
    """Cart alone: driven for 1 s, then coasting to a stop; both parts are exponentials with an end."""
    level, volt = 3.0, 1.5
    friction = [{"kind": "coulomb_friction", "site": "cart", "level": level}]
    u = np.zeros((401, 2))
    u[:200, 0] = volt
    run = rig.simulate(plain(friction, parts="cart"), u, 2.0, 0, START, noisy=False)
    mass, damping = BRIDGE["cart_mass"], BRIDGE["cart_damping"]
    lag, slow = mass / damping, level / damping
    steady = (BRIDGE["cart_gain"] * volt - level) / damping
    speed = steady * (1 - math.exp(-1 / lag))
    driven = steady - lag * speed
    stop = lag * math.log1p(speed / slow)
    coasted = lag * speed - slow * stop
    assert run["x"][-1] - run["x"][0] == pytest.approx(driven + coasted, abs=5e-6)


def test_a_constant_force_beside_friction_is_friction_by_direction():
    """The equivalence that the scorer accepts, on the rig itself, sliding and sticking."""
    u, level, force = volts(2.0), 3.0, 0.4
    pushed = [
        {"kind": "coulomb_friction", "site": "cart", "level": level},
        {"kind": "constant_force", "site": "cart", "level": force},
    ]
    split = [
        {
            "kind": "direction_dependent_friction",
            "site": "cart",
            "positive": level - force,
            "negative": level + force,
        }
    ]
    one, other = (rig.simulate(plain(e), u, 2.0, 0, START, noisy=False) for e in (pushed, split))
    np.testing.assert_allclose(one["x"], other["x"], atol=1e-9, rtol=0)


def test_belt_agrees_with_two_masses_and_a_spring():
    belt = {
        "kind": "belt_compliance", "site": "cart", "stiffness": 3000.0, "damping": 10.0, "motor_mass": 1.5,
    }  # fmt: skip
    u = volts(1.0)
    run = rig.simulate(plain([belt], parts="cart"), u, 1.0, 0, START, noisy=False)

    def two_masses(t, y, u_x, u_l):
        motor, cart, motor_rate, cart_rate = y
        pull = 3000.0 * (cart - motor) + 10.0 * (cart_rate - motor_rate)
        drive = BRIDGE["cart_gain"] * u_x - BRIDGE["cart_damping"] * motor_rate
        return [motor_rate, cart_rate, (drive + pull) / 1.5, -pull / (BRIDGE["cart_mass"] - 1.5)]

    y, rows = np.array([0.75, 0.75, 0.0, 0.0]), [0.75]
    for row in u[:-1]:
        y = solve_ivp(two_masses, (0, rig.SAMPLE), y, args=tuple(row), rtol=1e-9, atol=1e-11).y[:, -1]
        rows.append(y[1])
    np.testing.assert_allclose(run["x"], rows, atol=5e-6, rtol=0)


def test_double_pendulum_has_its_two_periods():
    """Small swings: the two modes of masses m, M at l and l + b from det(K - w^2 M) = 0."""
    hook, load, l, b, g = 0.07, 0.13, 0.6, 0.15, 9.81
    mass = np.array([[(hook + load) * l**2 + 2 * load * l * b + load * b**2, load * b * (l + b)], [0.0, load * b**2]])
    mass[1, 0] = mass[0, 1]
    stiffness = g * np.array([[(hook + load) * l + load * b, load * b], [load * b, load * b]])
    modes = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))
    numbers = BRIDGE | {"load_mass": hook + load, "swing_damping": 0.0}
    double = {"kind": "double_pendulum", "site": "swing", "hook_mass": hook, "link": b, "damping": 0.0}
    truth = plain([double], bridge=numbers, parts="pendulum", rope="locked")
    start = {"psi": 0.02, "l": l}
    psi = rig.simulate(truth, np.zeros((1, 2)), 8.0, 0, start, noisy=False)["psi"]
    t = np.arange(len(psi)) * rig.SAMPLE
    # From rest the upper angle is a sum of the two cosines; 1 % is the swing's own nonlinearity.
    waves = np.cos(np.outer(t, modes))
    weights = np.linalg.lstsq(waves, psi, rcond=None)[0]
    assert np.abs(weights).min() > 1e-4
    assert np.std(psi - waves @ weights) < 0.01 * np.std(psi)


def test_steady_wind_turns_the_vertical():
    force = 0.05
    blowing = {"kind": "wind", "site": "swing", "force": force, "start": -1.0, "stop": 1e3}
    truth = plain([blowing], bridge=BRIDGE | {"swing_damping": 0.5}, parts="pendulum", rope="locked")
    psi = rig.simulate(truth, np.zeros((1, 2)), 6.0, 0, {"l": 0.5}, noisy=False)["psi"][-1]
    assert psi == pytest.approx(math.atan(force / (BRIDGE["load_mass"] * BRIDGE["gravity"])), rel=1e-4)


def test_presliding_springs_back():
    """A push below the level bends the Dahl spring and comes back; the level is what it takes to slide on."""
    dahl = {"kind": "presliding_friction", "site": "cart", "level": 4.0, "stiffness": 2000.0}
    # Slowly, so that nothing rings: up to half the level in 1.5 s, and down again.
    u = np.zeros((601, 2))
    u[:, 0] = np.interp(np.arange(601), [0, 300, 600], [0.0, 2.0, 0.0]) / BRIDGE["cart_gain"]
    x = rig.simulate(plain([dahl], parts="cart"), u, 3.0, 0, START, noisy=False)["x"]
    bent = 4.0 / 2000.0 * math.log(2)  # F = level (1 - exp(-stiffness s / level)) on first loading
    # Damping takes 0.06 N of the 2 N while the push grows, which is 5 % of the bend.
    assert x[300] - x[0] == pytest.approx(bent, rel=0.08)
    assert 0.0 < x[-1] - x[0] < 0.5 * bent


@pytest.mark.parametrize(("value", "shown"), [(0.123449, 0.1234), (0.123451, 0.1235), (-0.00004, 0.0)])
def test_quantiser(value, shown):
    assert sensors.quantise(value, 1e-4) == pytest.approx(shown, abs=1e-12)


def test_noise_has_the_promised_size():
    key = np.random.default_rng(1)
    for channel, total in sensors.NOISE.items():
        sensor = sensors.Sensor(channel, [], 20_000, rig.SAMPLE, {}, key)
        true = key.uniform(0.4, 0.6, 20_000)
        errors = [sensor.read(k, 0.0, x) - x for k, x in enumerate(true)]
        assert np.std(errors) == pytest.approx(total, rel=0.03)


@pytest.mark.parametrize("kind", [{}, {"wander": 0.05}, {"noise": {"x": {"total": 6e-5, "correlation": 0.03}}}])
def test_the_same_seed_gives_the_same_recording(kind):
    truth = plain([{"kind": "coulomb_friction", "site": "cart", "level": 3.0}], **kind)
    first, second, other = (rig.simulate(truth, volts(0.5), 0.5, seed, START) for seed in (7, 7, 8))
    assert all(np.array_equal(first[c], second[c]) for c in first)
    assert not np.array_equal(first["x"], other["x"])


def catalogue():
    return sorted({(kind, site) for half in cases.HALVES for kind, site in _concealed(half)})


def _concealed(half):
    for truth in cases.cases(half).values():
        yield from ((e["kind"], e["site"]) for e in truth["concealed"])


def test_every_kind_of_the_catalogue_is_played_or_says_why_not():
    with_the_rig = {name.split()[0] for names in cases.OWNED.values() for name in names}
    played = {kind for kind, _ in kinds.KINDS} | with_the_rig
    assert not played & set(kinds.NOT_PLAYED)
    assert set(CATALOGUE) <= played | set(kinds.NOT_PLAYED)


def test_a_force_limit_and_a_speed_loop_cut_the_same_force():
    """Cart alone, limited all the time: a motor's limit leaves the damping, which a loop's limit takes with it."""
    u, limit = np.tile([3.0, 0.0], (201, 1)), 12.0
    mass, damping = BRIDGE["cart_mass"], BRIDGE["cart_damping"]
    times = np.arange(201) * rig.SAMPLE
    lag = mass / damping
    steady = limit / damping
    for kind, more, way in (
        ("force_limit", {}, steady * (times - lag * (1 - np.exp(-times / lag)))),
        ("speed_drive", {"time_constant": 1e-6, "share": 1.0}, limit / mass * times**2 / 2),
    ):
        effect = {"kind": kind, "site": "cart_drive", "limit": limit} | more
        cut = times < 0.25  # after that the loop comes near its speed, and below its limit
        run = rig.simulate(plain([effect], parts="cart"), u, 1.0, 0, START, noisy=False)
        np.testing.assert_allclose((run["x"] - START["x"])[cut], way[cut], atol=2e-5, rtol=0)


def test_a_slow_clock_shows_in_the_time_stamps_alone():
    u = volts(1.0)
    slow = {"kind": "clock_scale", "site": "clock", "scale": 1.02}
    one, other = (rig.simulate(plain(e), u, 1.0, 0, START, noisy=False) for e in ([], [slow]))
    np.testing.assert_allclose(one["t"], 1.02 * other["t"], atol=1e-12)
    assert all(np.array_equal(one[c], other[c]) for c in one if c != "t")


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "site"), [k for k in catalogue() if k[0] not in ("wrong_value", "clock_scale")])
def test_every_concealed_effect_acts(kind, site):
    """Without it the same rig moves or reads differently."""
    truth = next(
        t
        for h in cases.HALVES
        for t in cases.cases(h).values()
        for e in t["concealed"]
        if (e["kind"], e["site"]) == (kind, site)
    )
    rest = [e for e in truth["effects"] if (e["kind"], e["site"]) != (kind, site)]

    def difference(plan):
        table = play.play(truth, plan)
        u = np.column_stack([table["u_x"], table["u_l"]])
        with_it, without = (
            rig.simulate(truth | {"effects": effects}, u, table["t"][-1], 0, plan["start"], noisy=False)
            for effects in (truth["effects"], rest)
        )
        return max(np.abs(with_it[c] - without[c]).max() / sensors.NOISE[c] for c in sensors.NOISE)

    assert any(difference(plan) > 3.0 for plan in truth["recordings"] if plan["name"].startswith("train"))


@pytest.mark.parametrize("half", sorted(cases.MASTER))
def test_seals_hold(half):
    truths = seal.open_truths(half)
    assert sorted(truths) == sorted(json.loads(seal.SEALS.read_text())[half])
    nulls = [t for t in truths.values() if t["verdict"] == "adequate"]
    assert len(truths) == len(cases.HALVES[half])
    assert len(nulls) >= 10 or half in ("rough", "hybrid", "laws", "starts", "coasts", "blind", "blind2", "blind3")
    for truth in truths.values():
        given = [(e["kind"], e["site"]) for e in truth["model"]["effects"]]
        assert not [e for e in truth["concealed"] if (e["kind"], e["site"]) in given]


def test_a_changed_truth_is_refused(tmp_path, monkeypatch):
    lines = (HERE / "sealed-dev.txt").read_text().splitlines()
    name, sealed = lines[0].split()
    changed = seal.pack(seal.unpack(sealed).replace(b'"cart_gain": 1', b'"cart_gain": 2'))
    (tmp_path / "sealed-dev.txt").write_text("\n".join([f"{name} {changed}", *lines[1:]]))
    monkeypatch.setattr(seal, "HERE", tmp_path)
    with pytest.raises(ValueError, match=name):
        seal.open_truths("dev")


def truth_of(concealed, verdict="missing_physics", equations=("cart",), equivalents=()):
    model = {"bridge": {"cart_gain": 15.0, "known": []}, "effects": []}
    return {
        "id": "case", "flavour": "full", "loop": "open", "concealed": list(concealed), "verdict": verdict,
        "model": model, "equations": list(equations), "equivalents": list(equivalents), "bridge": BRIDGE,
        "effects": list(concealed),
    }  # fmt: skip


def report_of(verdict, equation="cart", effects=()):
    def named(e):
        numbers = {k: {"value": v, "low": v * 0.98, "high": v * 1.02} for k, v in e[2].items()}
        rivals = [{"kind": k, "site": s} for k, s in (e[3] if len(e) > 3 else ())]
        return {"kind": e[0], "site": e[1], "parameters": numbers, "equivalents": rivals}

    errors = {"before": {"x": 9e-4}, "after": {"x": 1e-4}}
    return {
        "verdict": verdict, "location": {"equation": equation}, "effects": [named(e) for e in effects],
        "fit": {"holdout": errors, "noise": {"x": 1e-4}}, "seconds": 1.0,
        "bridge": {"cart_gain": {"value": 16.1, "low": 16.05, "high": 16.2}},
    }  # fmt: skip


DELAY = {"kind": "input_delay", "site": "cart_drive", "delay": 0.02}
PUSH = {"kind": "constant_force", "site": "cart", "level": 0.3}
SPLIT = {
    "for": "constant_force cart",
    "kind": "direction_dependent_friction",
    "site": "cart",
    "why": "the same law",
}


def test_score_right():
    row = score(
        truth_of([DELAY]),
        report_of("missing_physics", effects=[("input_delay", "cart_drive", {"delay": 0.0202})]),
    )
    keys = ("verdict_right", "detected", "equation_right", "first_right", "in_set", "set_right")
    assert all(row[k] for k in keys)
    delay = row["parameters"]["input_delay cart_drive.delay"]
    assert delay["error"] == pytest.approx(0.01) and delay["covered"]
    assert row["gap_closed"] == pytest.approx(1.0) and row["before"] == pytest.approx(9.0)
    assert row["bridge"]["cart_gain"]["covered"] is False


def test_score_wrong():
    row = score(truth_of([DELAY]), report_of("missing_physics", effects=[("actuator_lag", "cart_drive", {})]))
    assert row["verdict_right"] and row["equation_right"]
    assert not row["first_right"] and not row["set_right"] and not row["in_set"]
    assert not row["parameters"] and not row["bridge"]


def test_score_declared_rival():
    said = report_of("missing_physics", effects=[("actuator_lag", "cart_drive", {}, [("input_delay", "cart_drive")])])
    row = score(truth_of([DELAY]), said)
    assert row["in_set"] and not row["first_right"]


def test_score_equivalent():
    said = report_of(
        "missing_physics",
        effects=[("direction_dependent_friction", "cart", {"positive": 0.0, "negative": 0.6})],
    )
    row = score(truth_of([PUSH], equivalents=[SPLIT]), said)
    assert row["first_right"] and row["set_right"]
    assert not row["parameters"], "numbers of another form are not compared"
    superfluous = report_of(
        "missing_physics",
        effects=[("constant_force", "cart", {"level": 0.3}), ("direction_dependent_friction", "cart", {})],
    )
    assert not score(truth_of([PUSH], equivalents=[SPLIT]), superfluous)["set_right"]


def test_score_equivalent_of_all_parts():
    """One that no sealed truth of the part has: levels F - c and F + c are F beside a constant c."""
    truth = truth_of([{"kind": "direction_dependent_friction", "site": "hoist", "positive": 0.0, "negative": 0.3}])
    said = report_of("missing_physics", "hoist", effects=[("constant_force", "hoist", {})])
    assert score(truth, said)["set_right"]
    assert not score(truth | {"flavour": "locked"}, said)["set_right"]


def test_score_unknown_and_null():
    strange = truth_of([{"kind": "sagging_rail", "site": "cart"}], "unknown")
    assert score(strange, report_of("unknown"))["verdict_right"]
    assert not score(strange, report_of("missing_physics", effects=[("spring_force", "cart", {})]))["verdict_right"]
    null = truth_of([], "adequate", ["none"])
    assert score(null, report_of("adequate", "none"))["verdict_right"]
    assert score(null, report_of("unknown"))["detected"]
    assert score(null, report_of("adequate", "none"))["bridge"]["cart_gain"]["error"] == pytest.approx(0.1 / 16)


def test_score_of_a_failed_run_is_all_wrong():
    row = score(truth_of([DELAY]), None)
    assert row["verdict"] == "failed" and not row["detected"]


def test_numbers_are_compared_as_the_same_law():
    wave = {"kind": "periodic_force", "site": "cart", "amplitude": 0.3, "period": 0.1, "phase": 1.0}
    turned = {
        "amplitude": {"value": -0.3, "low": -0.31, "high": -0.29},
        "period": {"value": 0.1},
        "phase": {"value": 1.0 - math.pi},
    }
    rows = parameter_errors(wave, turned)
    assert max(r["error"] for r in rows.values()) == pytest.approx(0.0, abs=1e-12) and rows["amplitude"]["covered"]
    table = {"kind": "position_dependent_friction", "site": "cart", "knots": [0.0, 1.0], "levels": [0.0, 1.0]}
    lifted = {"knots": {"value": [0.0, 0.5, 1.0]}, "levels": {"value": [2.0, 2.5, 3.0]}}
    assert parameter_errors(table, lifted)["levels"]["error"] == pytest.approx(0.0)
    drum = {"kind": "drum_radius_change", "site": "hoist_drive", "slope": 0.2, "length": 0.7}
    said = report_of(
        "missing_physics",
        "hoist",
        [("drum_radius_change", "hoist_drive", {"slope": 0.2 / 1.04, "length": 0.9})],
    )
    row = score(truth_of([drum], equations=["hoist"]), said)
    assert row["parameters"]["drum_radius_change hoist_drive.slope"]["error"] == pytest.approx(0.0, abs=1e-12)


def test_table_lists_the_misses_by_name():
    right = score(
        truth_of([DELAY]),
        report_of("missing_physics", effects=[("input_delay", "cart_drive", {"delay": 0.02})]),
    )
    wrong = score(truth_of([DELAY]), report_of("adequate", "none")) | {"id": "missed"}
    half = {
        "half": "dev",
        "rows": [right | {"wall": 3.0}, wrong | {"wall": 5.0}],
        "commit": "",
        "cores": 2,
        "cases": 2,
    }
    page = tables.table({"dev": half})
    assert "`missed`" in page and "`case`" not in page
    assert "detected where the base model's hold-out error is >= 5 noise | >= 98 % | 50 % (1/2" in page


def test_cases_run_again_are_a_column_and_no_proof(tmp_path, monkeypatch):
    figures = importlib.import_module("figures")
    told = report_of("missing_physics", effects=[("input_delay", "cart_drive", {"delay": 0.02})])
    right = score(truth_of([DELAY]), told) | {"wall": 3.0, "before": 7.0, "probability": 0.95}
    wrong = score(truth_of([DELAY]), report_of("adequate", "none")) | {"wall": 5.0, "before": 7.0}
    for part, row in (("fresh", wrong), ("fresh-again", right)):
        saved = {"half": "fresh", "commit": part, "cores": 2, "cases": 1, "rows": [row]}
        (tmp_path / "data").mkdir(exist_ok=True)
        (tmp_path / "data" / f"concealed-{part}.json").write_text(json.dumps(saved))
    counted, dots = [], figures._dots

    def noted(axes, points, *rest, **how):
        counted.append(points)
        dots(axes, points, *rest, **how)

    monkeypatch.setattr(figures, "_dots", noted)
    monkeypatch.setattr(figures, "confusion", lambda *rest: None)
    figures.draw(tmp_path)
    page = (tmp_path / "concealed-table.md").read_text()
    verdicts = next(line for line in page.splitlines() if line.startswith("| verdict right"))
    assert [cell.strip()[:5] for cell in verdicts.split("|")[3:5]] == ["0 % (", "100 %"]
    names, seen, _ = counted
    assert names == [] and [hits for _, hits, n in seen if n] == [0]


def test_the_list_of_cases_says_what_was_concealed_and_named():
    told = report_of("missing_physics", effects=[("input_delay", "cart_drive", {"delay": 0.02})])
    rows = [
        score(truth_of([DELAY]), told) | {"wall": 30.0, "status": 0, "before": 7.0, "after": 1.1},
        score(truth_of([DELAY]), report_of("adequate", "none"))
        | {"wall": 50.0, "status": 0, "before": 7.0, "after": 7.0},
    ]
    [row] = tables.parts({"cases": [r | {"id": f"rough-0{k}"} for k, r in enumerate(rows)]}).splitlines()[-1:]
    assert row.startswith("| [rough](concealed-cases.md) | 2 | 50 % (1/2; ")
    assert "| 1 of 1 | 0 of 0 | 40 (50) |" in row
    first, second = tables.cases(rows).splitlines()[-2:]
    assert "`missing physics` | input delay cart drive | 7 to 1.1 | 30 |" in first
    assert "`adequate` | nothing | 7 to 7 | 50 |" in second


@pytest.mark.parametrize(
    ("effect", "where", "when", "expected"),
    [
        (
            {"kind": "brake_zone", "site": "cart", "centre": 0.8, "width": 0.1, "peak": 1.0, "critical": 0.2},
            [{"variable": "v_x", "low": 0.7, "high": 0.9}, {"variable": "x", "low": 0.75, "high": 0.95}],
            [],
            {"overlap": 0.15 / 0.25},
        ),
        (
            {"kind": "swing_guide", "site": "swing", "angle": 0.1, "stiffness": 1.0},
            [{"variable": "psi", "low": 0.2, "high": 0.5}],
            [],
            {"overlap": 0.75},
        ),
        (
            {"kind": "wind", "site": "swing", "force": 0.01, "start": 4.0, "stop": 8.0},
            [],
            [
                {"recording": "a", "start": 1.0, "stop": 3.0},
                {"recording": "a", "start": 4.0, "stop": 6.0},
                {"recording": "b", "start": 4.0, "stop": 7.0},
            ],
            {"overlap": 0.625},
        ),
        (
            {"kind": "missed_counts", "site": "x_sensor", "jump": 0.001, "time": 5.0},
            [],
            [{"recording": "a", "start": 5.0, "stop": 5.1}],
            {"late": 0.05},
        ),
        ({"kind": "missed_counts", "site": "x_sensor", "jump": 0.001, "time": 5.0}, [], [], {"late": None}),
    ],
    ids=["zone", "open end", "push", "jump", "not found"],
)
def test_places_and_times_are_scored(effect, where, when, expected):
    report = report_of("unknown")
    report["location"] |= {"where": where, "when": when}
    (found,) = score(truth_of([effect]), report)["placed"].values()
    assert found == pytest.approx(expected)
