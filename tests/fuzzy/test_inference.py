"""Inference against scikit-fuzzy, MATLAB's published values, and the limits of the smooth mode."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import skfuzzy
from jax.test_util import check_grads

from jbridge.fuzzy.defuzzify import DEFUZZIFIERS, Bisector, Centroid, MeanOfMaximum
from jbridge.fuzzy.files.fis_reader import load_fis
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.membership import Bell, Gaussian, Trapezoidal, Triangular, as_number, membership
from jbridge.fuzzy.merged_grid import columns
from jbridge.fuzzy.norms import Maximum, Minimum, ProbabilisticSum, Product, Sum
from jbridge.fuzzy.rules import Clause, Rule, Variable, in_words, rule
from jbridge.fuzzy.sugeno import Conclusions, Linear, Sugeno
from tests.fuzzy.systems import TIPPER, random_system

ORACLE_SETS = {
    "trimf": lambda x, s: skfuzzy.trimf(x, [s.left, s.peak, s.right]),
    "trapmf": lambda x, s: skfuzzy.trapmf(x, [s.left, s.top_left, s.top_right, s.right]),
    "gaussmf": lambda x, s: skfuzzy.gaussmf(x, float(s.centre), float(s.width)),
    "gbellmf": lambda x, s: skfuzzy.gbellmf(x, float(s.width), float(s.slope), float(s.centre)),
    "sigmf": lambda x, s: skfuzzy.sigmf(x, float(s.centre), float(s.slope)),
    # scikit-fuzzy has no straight S and Z.
    "linsmf": lambda x, s: np.interp(x, [float(s.foot), float(s.shoulder)], [0.0, 1.0]),
    "linzmf": lambda x, s: np.interp(x, [float(s.shoulder), float(s.foot)], [1.0, 0.0]),
    "smf": lambda x, s: skfuzzy.smf(x, float(s.foot), float(s.shoulder)),
    "zmf": lambda x, s: skfuzzy.zmf(x, float(s.shoulder), float(s.foot)),
    "pimf": lambda x, s: skfuzzy.pimf(x, *map(float, (s.left, s.top_left, s.top_right, s.right))),
    "gauss2mf": lambda x, s: skfuzzy.gauss2mf(
        x, float(s.left_centre), float(s.left_width), float(s.right_centre), float(s.right_width)
    ),
    "dsigmf": lambda x, s: np.abs(
        skfuzzy.dsigmf(x, *map(float, (s.first_centre, s.first_slope, s.second_centre, s.second_slope)))
    ),
    "psigmf": lambda x, s: skfuzzy.psigmf(
        x, *map(float, (s.first_centre, s.first_slope, s.second_centre, s.second_slope))
    ),
}
ORACLE_NORMS = {
    "min": np.fmin,
    "prod": np.multiply,
    "max": np.fmax,
    "sum": np.add,
    "probor": lambda a, b: a + b - a * b,
}


def oracle(system, values):
    """The textbook's inference with scikit-fuzzy's sets and defuzzification; None where no rule fires."""
    degrees = []
    for variable, value in zip(system.inputs, values, strict=True):
        inside = np.array([np.clip(float(value), float(variable.low), float(variable.high))])
        degrees.append([ORACLE_SETS[s.kind](inside, s)[0] for s in variable.sets])
    output = system.outputs[0]
    grid = np.linspace(float(output.low), float(output.high), system.points)
    total = None
    for found in system.rules:
        parts = [degrees[c.variable][c.label] for c in found.antecedent]
        parts = [1 - p if c.negated else p for p, c in zip(parts, found.antecedent, strict=True)]
        norm = ORACLE_NORMS[(system.disjunction if found.any_of else system.conjunction).name]
        strength = parts[0]
        for part in parts[1:]:
            strength = norm(strength, part)
        member = output.sets[found.consequent[0].label]
        shape = ORACLE_NORMS[system.implication.name](ORACLE_SETS[member.kind](grid, member), found.weight * strength)
        total = shape if total is None else ORACLE_NORMS[system.aggregation.name](total, shape)
    if not total.max() > 1e-9:
        return None
    top = total.max()
    if system.defuzzifier.name == "mom" and ((total > top - 1e-6) != (total > top - 1e-11)).any():
        return None  # a top so round that rounding decides where it is
    return float(skfuzzy.defuzz(grid, np.round(total, 12), system.defuzzifier.name))


def width(system):
    return float(system.outputs[0].high - system.outputs[0].low)


@pytest.mark.parametrize("block", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in (1, 2, 3))])
def test_a_thousand_random_systems_agree_with_scikit_fuzzy(block):
    """At 1,001 points, to 1e-3 of the range.

    Points weigh as much at the ends of the universe as elsewhere, as in MATLAB; scikit-fuzzy integrates, so there they
    weigh half. Where a set stands against an end, that alone may be up to 2e-3.
    """
    errors = []
    for seed in range(250 * block, 250 * (block + 1)):
        system, values = random_system(seed)
        wanted = oracle(system, values)
        if wanted is not None:
            errors.append(abs(float(system.infer(values).output[0]) - wanted) / width(system))
    assert len(errors) > 200
    assert np.sum(np.array(errors) > 1e-3) <= 3 and max(errors) < 2e-3


@pytest.mark.parametrize("defuzzifier", [Bisector(), MeanOfMaximum()], ids=["bisector", "mom"])
def test_other_defuzzifiers_agree_with_scikit_fuzzy(defuzzifier):
    for seed in range(1000, 1060):
        system, values = random_system(seed, defuzzifier=defuzzifier)
        wanted = oracle(system, values)
        if wanted is not None:
            assert abs(float(system.infer(values).output[0]) - wanted) < 1e-3 * width(system), seed


@pytest.mark.parametrize(("service", "food", "tip"), [(2, 1, 7.0169), (4, 5, 14.4585), (7, 8, 20.3414)])
def test_matlabs_tipper(tmp_path, service, food, tip):
    """Published to four decimals in the documentation of MATLAB's `evalfis`, for 101 points."""
    path = tmp_path / "tipper.fis"
    path.write_text(TIPPER)
    found = load_fis(path).infer(jnp.array([service, food], float))
    assert float(found.output[0]) == pytest.approx(tip, abs=5.1e-5)


def tent(name="y", labels=("low", "high")):
    sets = (Triangular(*map(as_number, (-1.0, -0.5, 0.0))), Triangular(*map(as_number, (0.0, 0.5, 1.0))))
    return Variable(name, as_number(-1.0), as_number(1.0), labels, sets)


def test_inputs_beyond_their_range_count_as_its_end():
    system, _ = random_system(3)
    highs = jnp.stack([v.high for v in system.inputs])
    np.testing.assert_array_equal(system.infer(highs + 100.0).output, system.infer(highs).output)


@pytest.mark.parametrize("softness", [None, 0.1])
@pytest.mark.parametrize("defuzzifier", list(DEFUZZIFIERS.values()))
def test_where_no_rule_fires_the_output_is_the_middle(defuzzifier, softness):
    x, y = tent("x"), tent()
    system = Mamdani((x,), (y,), (rule("if x is low then y is low", (x,), (y,)),), defuzzifier=defuzzifier())
    found = system.infer(jnp.array([0.5]), softness=softness)
    assert not found.fired[0] and found.output[0] == 0.0
    assert system.infer(jnp.array([-0.5]), softness=softness).fired[0]


def test_smooth_inference_tends_to_the_hard_one():
    """Its distance shrinks in proportion to the softness."""
    for seed in range(30):
        system, values = random_system(seed, points=101)
        hard = system.infer(values)
        if not bool(hard.fired[0]) or float(hard.strength.max()) < 0.05:
            continue
        errors = [
            abs(float(system.infer(values, softness=s).output[0] - hard.output[0])) / width(system)
            for s in (1e-2, 1e-3, 1e-4)
        ]
        assert errors[2] < 1e-3, seed
        assert errors[2] <= 0.2 * errors[0] + 1e-6, seed


@pytest.mark.parametrize("softness", [pytest.param(None, marks=pytest.mark.slow), 0.05])
def test_every_gradient_is_finite(softness):
    """Also on corners, at ties, for flanks of no width and where no rule fires."""
    grads = jax.jit(jax.grad(lambda s, v: s.infer(v, softness=softness).output[0], argnums=(0, 1), allow_int=True))
    for seed in range(4):
        system, values = random_system(seed, points=101)
        flat = system.inputs[0]
        corner = getattr(flat.sets[0], "left", flat.middle)
        for value in (values, values.at[0].set(corner), values.at[0].set(flat.low - 1)):
            found = jax.tree.leaves(grads(system, value))
            assert all(np.isfinite(np.asarray(leaf)).all() for leaf in found), seed


@pytest.mark.parametrize("defuzzifier", list(DEFUZZIFIERS.values()))
def test_degenerate_systems_have_finite_gradients(defuzzifier):
    """Sets of no width at the value itself, equal strengths, and an aggregate that is empty."""
    spike = Triangular(*map(as_number, (0.2, 0.2, 0.2)))
    x = Variable("x", as_number(-1.0), as_number(1.0), ("a", "b"), (spike, spike))
    y = Variable("y", as_number(-1.0), as_number(1.0), ("p", "q"), (spike, tent().sets[0]))
    rules = tuple(rule(text, (x,), (y,)) for text in ("if x is a then y is p", "if x is b then y is q"))
    system = Mamdani((x,), (y,), rules, defuzzifier=defuzzifier())
    for softness in (None, 0.1):
        for value in (0.2, 0.5):
            leaves = jax.tree.leaves(
                jax.grad(lambda s: s.infer(jnp.array([value]), softness=softness).output[0])(system)
            )
            assert all(np.isfinite(np.asarray(leaf)).all() for leaf in leaves)


def test_smooth_gradients_agree_with_differences():
    """Central differences, away from nothing: the smooth mode has no kinks."""
    step, compared = 1e-5, 0
    for seed in range(7):
        system, _ = random_system(seed, points=101, norms=(Minimum(), Maximum(), Minimum(), Maximum()))
        inside = jnp.stack([v.middle + 0.31 * (v.high - v.low) for v in system.inputs])
        if not bool(system.infer(inside).fired[0]):
            continue
        compared += 1
        found = jax.grad(lambda v: system.infer(v, softness=0.2).output[0])(inside)
        for i in range(len(inside)):
            up, down = (system.infer(inside.at[i].add(s), softness=0.2).output[0] for s in (step, -step))
            wanted = float(up - down) / (2 * step)
            scale = max(abs(wanted), 1e-3 * width(system))
            assert abs(float(found[i]) - wanted) < 1e-3 * scale, (seed, i)
    assert compared > 2


def test_sugeno_by_hand():
    """Two rules of strengths 0.5 and 0.25 that conclude 1 + 2 x and 3."""
    x = tent("x")
    out = Conclusions(
        "y",
        as_number(0.0),
        as_number(10.0),
        ("line", "flat"),
        (Linear(as_number([2.0]), as_number(1.0)), Linear(as_number([0.0]), as_number(3.0))),
    )
    rules = (
        rule("if x is high then y is line", (x,), (out,)),
        rule("if x is high then y is flat", (x,), (out,), weight=0.5),
    )
    for summed, wanted in ((False, (0.5 * 1.5 + 0.25 * 3) / 0.75), (True, 0.5 * 1.5 + 0.25 * 3)):
        found = Sugeno((x,), (out,), rules, summed=summed).infer(jnp.array([0.25]))
        assert float(found.output[0]) == pytest.approx(wanted)
    nothing = Sugeno((x,), (out,), rules).infer(jnp.array([-0.5]))
    assert float(nothing.output[0]) == 5.0 and not nothing.fired[0]


def test_rules_in_words():
    x, v, y = tent("error", ("NS", "PS")), tent("velocity", ("N", "P")), tent("voltage", ("NS", "PS"))
    text = "if error is NS and velocity is not P then voltage is NS"
    found = rule(text, (x, v), (y,))
    assert found.antecedent == (Clause(0, 0), Clause(1, 1, True)) and in_words(found, (x, v), (y,)) == text
    assert rule("IF (error is ns) or (Velocity is P) THEN (Voltage is ps).", (x, v), (y,)).any_of


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("error is NS then voltage is NS", "not of the form"),
        ("if error is NS and velocity is P or error is PS then voltage is NS", "mixes"),
        ("if error is huge then voltage is NS", "'huge' is none of NS, PS"),
        ("if speed is NS then voltage is NS", "'speed' is none of error, velocity"),
        ("if error NS then voltage is NS", "expected `<variable> is <set>`"),
        ("if then voltage is NS", "nothing stands beside"),
    ],
)
def test_words_that_are_no_rule(text, complaint):
    x, v, y = tent("error", ("NS", "PS")), tent("velocity", ("N", "P")), tent("voltage", ("NS", "PS"))
    with pytest.raises(ValueError, match=complaint):
        rule(text, (x, v), (y,))


def test_norms_are_the_textbooks():
    a, b = jnp.array([0.2, 0.9, 0.5]), jnp.array([0.7, 0.1, 0.5])
    for norm in (Minimum(), Product(), Maximum(), ProbabilisticSum(), Sum()):
        np.testing.assert_allclose(norm(a, b), ORACLE_NORMS[norm.name](a, b), rtol=1e-15)
        assert np.abs(norm(a, b, 0.1) - norm(a, b)).max() <= 0.05 * 0.5 + 1e-15
        # A degree of 0 stays 0 under a conjunction, whatever the softness.
        assert norm(jnp.zeros(()), jnp.asarray(0.3), 0.5) == (0.0 if norm.name in ("min", "prod") else 0.3)


def test_a_grid_has_both_ends():
    assert Centroid.name == "centroid"
    np.testing.assert_allclose(tent().grid(101)[jnp.array([0, 50, 100])], [-1.0, 0.0, 1.0], atol=1e-15)


def known_sets_case(seed):
    """A random system whose output's sets cover a part of the universe each, and values at which a rule fires."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.5, 2.5, (3, 1)) + np.sort(rng.uniform(-1.0, 1.0, (3, 3)), axis=1)
    sets = tuple(Triangular(*map(as_number, row)) for row in corners)
    output = Variable("out", as_number(-2.0), as_number(3.0), ("s0", "s1", "s2"), sets)
    system, values = random_system(seed, points=101)
    rules = tuple(
        Rule(found.antecedent, (Clause(0, k % 3),), found.weight, found.any_of) for k, found in enumerate(system.rules)
    )
    aggregation = [Maximum(), Sum(), ProbabilisticSum()][seed % 3]
    implication = [Minimum(), Product()][seed % 2]
    return Mamdani(system.inputs, (output,), rules, Minimum(), Maximum(), implication, aggregation), values


@pytest.mark.slow
@pytest.mark.parametrize("softness", [None, 0.1])
def test_sets_known_while_compiling_change_nothing_but_time(softness):
    """Gathered points against the plain grid, which is used for sets that are arguments: to rounding, gradients too."""
    compared = 0
    for seed in range(6):
        system, values = known_sets_case(seed)
        plain = jax.value_and_grad(lambda v, s: s.infer(v, softness=softness).output[0])
        gathered = jax.jit(lambda v: plain(v, system))
        wanted, found = jax.jit(plain)(values, system), gathered(values)
        assert "[101]" not in str(jax.make_jaxpr(gathered)(values))
        np.testing.assert_allclose(found[0], wanted[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found[1], wanted[1], rtol=1e-9, atol=1e-9)
        compared += bool(system.infer(values).fired[0])
    assert compared >= 3


def test_a_set_that_covers_everything_stays_on_the_grid():
    """A bell is nowhere 0: its columns would be as many as the points."""
    bells = tuple(Gaussian(as_number(0.3), as_number(c)) for c in (-0.61, 0.07, 0.52))
    output = Variable("y", as_number(-1.0), as_number(1.0), ("a", "b", "c"), bells)
    grid = output.grid(101)
    assert columns([member.degree(grid) for member in bells], grid) is None
    tents = tent()
    few = columns([member.degree(grid) for member in tents.sets], grid)
    assert few is not None and len(few) < 60 and sum(column.number for column in few) <= 101


@pytest.mark.parametrize(("width", "slope", "value"), [(0.0, 20.0, 0.3), (1e-3, 50.0, 3.0), (0.5, 2.0, 0.0)])
def test_a_bell_has_a_gradient_everywhere(width, slope, value):
    bell = Bell(as_number(width), as_number(slope), as_number(0.0))
    found = jax.grad(lambda b, v: b.degree(v), argnums=(0, 1))(bell, jnp.asarray(value))
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(found))


@pytest.mark.parametrize("softness", [None, 0.1])
@pytest.mark.parametrize("norm", [Minimum(), Maximum()])
def test_what_is_not_a_number_stays_so(norm, softness):
    nan, some = jnp.asarray(np.nan), jnp.asarray(0.3)
    assert np.isnan(norm(nan, some, softness)) and np.isnan(norm(some, nan, softness))


@pytest.mark.parametrize("norm", [Minimum(), Maximum()])
def test_written_out_derivatives_of_blurred_norms(norm):
    """Against differences, in both modes: of degrees apart, within reach of each other, and of the softness."""
    for a, b, softness in ((0.2, 0.9, 0.1), (0.50, 0.52, 0.1), (0.52, 0.5, 0.2), (0.3, 0.4, 0.9)):
        check_grads(
            lambda *args: norm(*map(as_number, args)), tuple(map(as_number, (a, b, softness))), 1, rtol=1e-6, atol=1e-8
        )


@pytest.mark.parametrize("softness", [None, 0.1])
@pytest.mark.parametrize("value", [-0.5, 0.02, 0.3, 0.96, 1.2, 1.49, 1.98, 2.5])
def test_written_out_derivatives_of_flanks(value, softness):
    """Against differences, sharp corners and rounded ones; then with an upright flank on either side."""

    def check(degree, *numbers):
        """`degree` takes a value, corners, and the softness, if there is one."""
        blur = () if softness is None else (softness,)
        check_grads(
            lambda *args: degree(*map(as_number, args)),
            tuple(map(as_number, (value, *numbers, *blur))),
            1,
            rtol=1e-5,
            atol=1e-8,
        )

    check(lambda v, a, b, c, d, *s: Trapezoidal(a, b, c, d).degree(v, *s), 0.0, 1.0, 1.5, 2.0)
    check(lambda v, c, d, *s: Trapezoidal(0.0, 0.0, c, d).degree(v, *s), 1.5, 2.0)
    check(lambda v, a, b, *s: Trapezoidal(a, b, 2.0, 2.0).degree(v, *s), 0.0, 1.0)


@pytest.mark.parametrize("softness", [None, 0.1])
def test_an_upright_flank_has_no_slope_to_follow(softness):
    corners = as_number([0.0, 0.0, 1.5, 2.0])
    slopes = jax.grad(lambda c: Trapezoidal(*c).degree(as_number(0.3), softness))(corners)
    np.testing.assert_array_equal(slopes, np.zeros(4))


@pytest.mark.parametrize("softness", [None, 0.1])
def test_a_system_made_ready_for_a_loop_infers_the_same(softness):
    """Also where its numbers are known to no compiler."""
    for seed in range(6):
        system, values = known_sets_case(seed)
        wanted = system.infer(values, softness=softness)
        found = jax.jit(lambda s, v: s.ready().infer(v, softness=softness))(system, values)
        np.testing.assert_allclose(found.output, wanted.output, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.strength, wanted.strength, rtol=1e-12)
        np.testing.assert_array_equal(found.fired, wanted.fired)


def test_many_rules_and_several_outputs_in_one_compiled_batch():
    """25 rules and three outputs: each output as by a system of its own, compiled in seconds."""
    labels, at = "abcde", np.linspace(-1.0, 1.0, 5)
    sets = tuple(membership("trimf", [place - 0.5, place, place + 0.5]) for place in at)
    x, y, u, v, w = (Variable(name, as_number(-1.0), as_number(1.0), tuple(labels), sets) for name in "xyuvw")
    pairs = list(itertools.product(range(5), range(5)))

    def system(outputs):
        rules = tuple(
            Rule((Clause(0, i), Clause(1, j)), tuple(Clause(n, (i + k * j) % 5) for n, (_, k) in enumerate(outputs)))
            for i, j in pairs
        )
        return Mamdani((x, y), tuple(output for output, _ in outputs), rules)

    each = [(u, 1), (v, 2), (w, 3)]
    values = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, (10, 2)))
    found = jax.jit(jax.vmap(lambda value: system(each).infer(value).output))(values)
    for place in (0, 9):
        wanted = [float(system([one]).infer(values[place]).output[0]) for one in each]
        np.testing.assert_allclose(found[place], wanted, atol=1e-12)
