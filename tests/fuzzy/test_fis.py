"""MATLAB's `.fis` format: what files in use hold, values computed by hand, and what is not read in silence."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge import InputError
from jbridge.fuzzy.defuzzify import DEFUZZIFIERS
from jbridge.fuzzy.files.fis_reader import load_fis
from jbridge.fuzzy.files.fis_writer import save_fis
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.membership import MEMBERSHIPS, Gathered, membership
from jbridge.fuzzy.rules import Clause, Rule, Variable, as_number, rule
from jbridge.fuzzy.sugeno import Conclusions, Linear, Sugeno
from tests.fuzzy.systems import TIPPER, any_system

SUGENO = """[System]
Name='two'
Type='sugeno'
NumInputs=1
NumOutputs=1
NumRules=2
AndMethod='prod'
OrMethod='probor'
ImpMethod='prod'
AggMethod='sum'
DefuzzMethod='wtaver'

[Input1]
Name='x'
Range=[0 1]
NumMFs=2
MF1='low':'trimf',[-1 0 1]
MF2='high':'trimf',[0 1 2]

[Output1]
Name='y'
Range=[0 10]
NumMFs=2
MF1='flat':'constant',[3]
MF2='line':'linear',[2 1]

[Rules]
1, 1 (1) : 1
2, 2 (1) : 1
"""


def read(folder, text, coding="utf-8", **options):
    path = folder / "system.fis"
    path.write_bytes(text if isinstance(text, bytes) else text.encode(coding))
    return load_fis(path, **options)


def output(system, *values):
    return float(system.infer(jnp.array(values, float)).output[0])


@pytest.mark.parametrize(
    ("kind", "numbers", "degrees"),
    [
        # At -1, 0, 1, 2, 3, 4, 5, from the formulas of the Fuzzy Logic Toolbox by hand.
        ("linsmf", [0, 4], [0, 0, 0.25, 0.5, 0.75, 1, 1]),
        ("linzmf", [0, 4], [1, 1, 0.75, 0.5, 0.25, 0, 0]),
        ("smf", [0, 4], [0, 0, 0.125, 0.5, 0.875, 1, 1]),
        ("zmf", [0, 4], [1, 1, 0.875, 0.5, 0.125, 0, 0]),
        ("smf", [4, 0], [0, 0, 0, 1, 1, 1, 1]),
        ("zmf", [4, 0], [1, 1, 1, 1, 0, 0, 0]),
        ("pimf", [-1, 1, 2, 4], [0, 0.5, 1, 1, 0.5, 0, 0]),
        ("gauss2mf", [1, 1, 2, 3], [np.exp(-2), np.exp(-0.5), 1, 1, 1, np.exp(-0.125), np.exp(-0.5)]),
        ("trapmf", [-np.inf, -np.inf, 1, 3], [1, 1, 1, 0.5, 0, 0, 0]),
        ("trapmf", [-np.inf, 0, 1, 3], [1, 1, 1, 0.5, 0, 0, 0]),
        ("trimf", [1, 3, np.inf], [0, 0, 0, 0.5, 1, 1, 1]),
        (
            "dsigmf",
            [np.log(3), 1, np.log(3), 3],
            [1 / 10 - 1 / 82, 1 / 4 - 1 / 28, 1 / 2 - 1 / 10, 3 / 4 - 1 / 4, 9 / 10 - 1 / 2, 3 / 14, 81 / 82 - 9 / 10],
        ),
        (
            "psigmf",
            [np.log(3), 0, -np.log(3), 2],
            [27 / 28 / 4, 0.5 * 0.9, 0.75**2, 0.9 * 0.5, 27 / 28 / 4, 81 / 82 / 10, 243 / 244 / 28],
        ),
    ],
)  # fmt: skip
def test_sets_have_the_degrees_of_matlabs_formulas(kind, numbers, degrees):
    found = membership(kind, [float(number) for number in numbers])
    at = np.arange(-1.0, 6.0)
    np.testing.assert_allclose(found.degree(jnp.asarray(at)), degrees, atol=1e-14)
    for place, wanted in zip(at, degrees, strict=True):
        np.testing.assert_allclose(Gathered.of([found]).degrees(as_number(place))[0], wanted, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "degree", "usual", "matlabs"),
    [
        # Areas 1/2, 1/4, 1/2, 3/4, 1: half of 3 is reached where t / 2 + t^2 / 4 = 1/4 beyond 0.
        # Degrees: half of 4 at 0.
        ("bisector", [1.0, 0.0, 0.5, 0.5, 1.0, 1.0], np.sqrt(2.0) - 1.0, 0.0),
        ("centroid", [1.0, 0.0, 0.0, 0.5, 0.5, 0.0], -2.5 / 2, -2.5 / 2),
        ("mom", [1.0, 0.0, 0.0, 1.0, 1.0, 0.0], -2 / 3, -2 / 3),
        ("som", [1.0, 0.0, 0.0, 1.0, 1.0, 0.0], -3.0, 0.0),
        ("lom", [1.0, 0.0, 0.0, 1.0, 1.0, 0.0], 1.0, -3.0),
    ],
)
def test_defuzzifiers_by_hand(name, degree, usual, matlabs):
    """At -3, -2, -1, 0, 1, 2."""
    found, grid = DEFUZZIFIERS[name](), jnp.arange(-3.0, 3.0)
    assert float(found(grid, jnp.array(degree))) == pytest.approx(usual)
    assert float(found.as_matlab()(grid, jnp.array(degree))) == pytest.approx(matlabs)


def test_inputs_beyond_their_range(tmp_path):
    """At service -3 `poor` has the degree exp(-2) as in MATLAB, and that of service 0, which is 1, otherwise."""
    for matlab, strength in ((False, 1.0), (True, np.exp(-2.0))):
        system = read(tmp_path, TIPPER, matlab=matlab)
        found = system.infer(jnp.array([-3.0, 5.0]))
        assert float(found.strength[0]) == pytest.approx(strength)
        assert eqx.tree_equal(system.ready().infer(jnp.array([-3.0, 5.0])).strength, found.strength)
    # Degrees 2 and -1 do not exist: `low` is 0 beyond 1, `high` is 1 - (1.5 - 1): the line gives 2 * 1.5 + 1.
    assert output(read(tmp_path, SUGENO, matlab=True), 1.5) == pytest.approx(4.0)
    assert output(read(tmp_path, SUGENO), 1.5) == pytest.approx(3.0)


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "gbk", "latin-1"])
def test_encodings(tmp_path, coding):
    name = "Größe" if coding == "latin-1" else "服务"
    text = TIPPER.replace("'service'", f"'{name}'")
    system = read(tmp_path, text, coding)
    assert system.inputs[0].name == name and output(system, 2, 1) == pytest.approx(7.0169, abs=5.1e-5)


def test_what_files_in_use_hold(tmp_path):
    """Comments after values, zeros that fill a row, sections in another order, labels used twice, apostrophes."""
    head, first, second, out, rules = TIPPER.split("\n\n")
    text = "\r\n\r\n".join((rules.rstrip(), out, head, second, first))
    for change in (
        ("'poor':'gaussmf',[1.5 0]", "'don't know':'gaussmf',[1.5 0 0 0] % 'was':'trimf',[0 1 2]"),
        ("'good':'gaussmf',[1.5 5]", "'don''t know' : 'gaussmf' , [1.5, 5]  # the same label"),
        ("Range=[0 30]", "Range=[0 30] % percent"),
        ("NumMFs=2", "NumMFs=2  % of food"),
        ("2 0, 2 (1) : 1", "2 0, 2 (1) : 1 % good"),
        ("[Input1]", "[Input1] % service"),
        ("Name='tip'", "Name='tip' % in percent"),
    ):
        assert change[0] in text
        text = text.replace(*change)
    system = read(tmp_path, text)
    assert system.inputs[0].labels == ("don't know", "don't know", "excellent") and system.outputs[0].name == "tip"
    assert output(system, 2, 1) == pytest.approx(7.0169, abs=5.1e-5)


def test_a_sugeno_output_may_have_equal_ends(tmp_path):
    system = read(tmp_path, SUGENO.replace("Range=[0 10]", "Range=[4 4]").replace("[3]", "[3 0 0]"))
    assert output(system, 0.25) == pytest.approx(0.75 * 3 + 0.25 * 1.5)


@pytest.mark.parametrize(
    ("text", "change", "complaint"),
    [
        (TIPPER, ("NumRules=3", "NumRules=4"), "line 7: NumRules is 4, but .Rules. has 3 rules"),
        (TIPPER, ("NumInputs=2", "NumInputs=1"), r"line 5: numinputs is 1, but there is a section \[Input2\]"),
        (TIPPER, ("NumInputs=2", "NumInputs=3"), r"\[Input3\] has no name"),
        (TIPPER, ("[Rules]", "[Input01]\nName='x'\n[Rules]"), r"numinputs is 2, but there is a section \[Input01\]"),
        (TIPPER, ("[Rules]", f"[Output1{5000 * '0'}]\n[Rules]"), r"there is a section \[Output1000"),
        (TIPPER, ("NumOutputs=1", "NumOutputs=²"), "where the number of those in the file belongs"),
        (TIPPER, ("NumMFs=3", "NumMFs=2"), "NumMFs is 2, but there is an MF3"),
        (TIPPER, ("[1.5 0]", "[1.5 NaN]"), "'poor' has a number that is NaN"),
        (TIPPER, ("[1.5 0]", "[1.5 Inf]"), "'poor' has an infinite number"),
        (TIPPER, ("[1.5 0]", "[1.5 0 1]"), "'poor' has 3 numbers; it needs width, centre"),
        (TIPPER, ("Range=[0 30]", "Range=[30 30]"), "both ends of the range are 30"),
        (TIPPER, ("NumInputs=2", "NumInputs=1000000000"), "numinputs is '1000000000', where the number"),
        (TIPPER, ("NumOutputs=1", "NumOutputs=1" + 5000 * "0"), "numoutputs is '1000.*', where the number"),
        (TIPPER, ("NumMFs=3", "NumMFs=4"), "has no mf4; add it"),
        (TIPPER, ("NumMFs=3", "NumMFs=99999"), "nummfs is '99999', where the number"),
        (TIPPER, ("Type='mamdani'", "Type='magic'"), "line 3: type 'magic' is not supported"),
        (TIPPER, ("Range=[0 30]", "Range=[30 0]"), "a range has a lower and a higher end"),
        (TIPPER, ("'gaussmf',[1.5 0]", "'wmf',[1.5 0]"), "is a 'wmf'; jbridge knows trimf"),
        (TIPPER, ("2 0, 2 (1) : 1", "9 0, 2 (1) : 1"), "service has no set 9; it has 3"),
        (TIPPER, ("2 0, 2 (1) : 1", f"1{400 * '0'} 0, 2 (1) : 1"), "service has no set inf; it has 3"),
        (TIPPER, ("2 0, 2 (1) : 1", "2, 2 (1) : 1"), "1 set numbers for 2 variables"),
        (TIPPER, ("2 0, 2 (1) : 1", "2 0, 2 (1.5) : 1"), "a weight lies between 0 and 1"),
        (TIPPER, ("[Rules]", "Rules]"), "is neither a"),
        (TIPPER, ("AndMethod", "AndMethode"), "unknown key 'andmethode'; did you mean 'andmethod'"),
        (TIPPER, ("Range=[0 30]", "Range=[0 30/0]"), "is not a list of numbers"),
        (TIPPER, ("Range=[0 30]", "Range=[0 30*e]"), "is not a list of numbers"),
        (TIPPER, ("[System]", "[Sistem]"), "no .System. section; this is not a .fis file"),
        (SUGENO, ("2, 2 (1) : 1", "2, -2 (1) : 1"), "cannot be negated"),
        (SUGENO, ("2, 2 (1) : 1", "0, 2 (1) : 1"), "the rule names no input or no output"),
        (SUGENO, ("2, 2 (1) : 1", "2, 0 (1) : 1"), "the rule names no input or no output"),
        (SUGENO, ("[2 1]", "[1]"), "linear needs 2 numbers"),
        (SUGENO, ("[2 1]", "[NaN 1]"), "linear has a number that is not finite"),
        (SUGENO, ("[2 1]", "[1_0 1]"), "is not a list of numbers"),
    ],
)
def test_what_is_wrong_with_a_fis_file_is_said(tmp_path, text, change, complaint):
    assert change[0] in text
    with pytest.raises(InputError, match=complaint) as found:
        read(tmp_path, text.replace(*change, 1))
    assert "\n" not in str(found.value)


def test_angles_are_written_with_pi(tmp_path):
    text = TIPPER.replace("[7 9 10 10]", "[-pi/4 pi/2, 2*pi 9e0]").replace("Range=[0 30]", "Range=[-pi 3/2*pi]")
    system = read(tmp_path, text)
    food = system.inputs[1].sets[1]
    np.testing.assert_allclose([float(n) for n in food.parameters()], [-np.pi / 4, np.pi / 2, 2 * np.pi, 9.0])
    assert (float(system.outputs[0].low), float(system.outputs[0].high)) == pytest.approx((-np.pi, 1.5 * np.pi))


@pytest.mark.parametrize("scale", [1e-10, 1e13])
def test_universes_of_any_width(scale):
    """What a system concludes grows with its universes, to rounding."""

    def system(size):
        sets = (
            membership("trapmf", [-size, -size, -0.5 * size, 0.0]),
            membership("trimf", [-0.5 * size, 0.2 * size, size]),
        )
        sets += (
            membership("gaussmf", [0.3 * size, size]),
            membership("pimf", [*(size * np.array([0.0, 0.2, 0.4, 0.9]))]),
        )
        x, y = (Variable(name, as_number(-size), as_number(size), ("a", "b", "c", "d"), sets) for name in "xy")
        rules = tuple(rule(f"if x is {label} then y is {label}", (x,), (y,)) for label in "abcd")
        return Mamdani((x,), (y,), rules)

    # Places that are no corners, where rounding would decide.
    for place in (-0.71, -0.23, 0.11, 0.33, 0.93):
        assert output(system(scale), scale * place) == pytest.approx(scale * output(system(1.0), place), rel=1e-9)


@pytest.mark.parametrize("kind", MEMBERSHIPS)
def test_every_kind_of_set_comes_back(tmp_path, kind):
    numbers = {"trimf": [-np.inf, 0.1, 2.0], "trapmf": [0.0, 1 / 3, 2.0, np.inf]}.get(kind, [1e-7, 0.1, 1 / 3, 0.7])
    made = membership(kind, numbers[: len(dataclasses.fields(MEMBERSHIPS[kind]))])
    variable = Variable("x", as_number(0.0), as_number(1.0), ("a",), (made,))
    system = Mamdani((variable,), (variable,), (rule("if x is a then x is a", (variable,), (variable,)),), matlab=True)
    save_fis(tmp_path / "s.fis", system)
    assert eqx.tree_equal(load_fis(tmp_path / "s.fis", matlab=True), system)


def test_what_a_fis_file_cannot_hold_is_not_written(tmp_path):
    system = read(tmp_path, TIPPER)
    twice = rule("if service is poor and service is not good then tip is cheap", system.inputs, system.outputs)
    lines = eqx.tree_at(lambda s: s.rules[0].weight, system, as_number(2.0))
    renamed = Variable("a\nb", as_number(0.0), as_number(1.0), system.inputs[0].labels, system.inputs[0].sets)
    for broken, complaint in (
        (Mamdani(system.inputs, system.outputs, (twice,)), "two clauses about one variable"),
        (Mamdani(system.inputs, system.outputs, system.rules, points=51), "101 points, not 51"),
        (Mamdani(system.inputs, system.outputs, system.rules, conjunction=system.disjunction), "`and` as min or prod"),
        (Mamdani((renamed, system.inputs[1]), system.outputs, system.rules), "a name of two lines"),
        (lines, "has the weight 2"),
    ):
        with pytest.raises(InputError, match=complaint):
            save_fis(tmp_path / "none.fis", broken)
    with pytest.raises(TypeError, match="a Mamdani or a Sugeno system, not a Prepared"):
        save_fis(tmp_path / "none.fis", system.ready())
    assert not (tmp_path / "none.fis").exists()


@pytest.mark.parametrize("seed", range(4))
def test_any_system_comes_back(tmp_path, seed):
    rng = np.random.default_rng(seed)
    for _ in range(10):
        system = any_system(rng)
        save_fis(tmp_path / "s.fis", system, "a 'name' % of its own")
        assert eqx.tree_equal(load_fis(tmp_path / "s.fis", matlab=system.matlab), system)


def test_any_sugeno_system_comes_back(tmp_path):
    rng = np.random.default_rng(0)
    for _ in range(10):
        before = any_system(rng)
        functions = tuple(
            Linear(rng.choice([0.0, 1 / 3, -1e300]) * rng.standard_normal(len(before.inputs)), rng.standard_normal())
            for _ in range(6)
        )
        outputs = tuple(Conclusions(o.name, o.low, o.low, tuple("aabbcc"), functions) for o in before.outputs)
        rules = tuple(
            Rule(r.antecedent, tuple(Clause(c.variable, 5) for c in r.consequent), r.weight, r.any_of)
            for r in before.rules
        )
        system = Sugeno(before.inputs, outputs, rules, summed=bool(rng.random() < 0.5))
        save_fis(tmp_path / "s.fis", system)
        assert eqx.tree_equal(load_fis(tmp_path / "s.fis"), system)


@pytest.mark.parametrize("where", ["sets", "range", "weight"])
def test_nan_is_not_written(tmp_path, where):
    system = read(tmp_path, TIPPER)
    place = {
        "sets": lambda s: s.inputs[0].sets[0].width,
        "range": lambda s: s.inputs[0].low,
        "weight": lambda s: s.rules[0].weight,
    }[where]
    with pytest.raises(InputError, match="nan|NaN"):
        save_fis(tmp_path / "none.fis", eqx.tree_at(place, system, as_number(np.nan)))
