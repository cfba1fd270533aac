"""Fuzzy systems that several tests share: MATLAB's tipper, and random ones."""

import jax.numpy as jnp
import numpy as np

from jbridge.fuzzy.defuzzify import DEFUZZIFIERS, Centroid
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.membership import MEMBERSHIPS, as_number
from jbridge.fuzzy.norms import Maximum, Minimum, ProbabilisticSum, Product, Sum
from jbridge.fuzzy.rules import Clause, Rule, Variable

TIPPER = """[System]
Name='tipper'
Type='mamdani'
Version=2.0
NumInputs=2
NumOutputs=1
NumRules=3
AndMethod='min'
OrMethod='max'
ImpMethod='min'
AggMethod='max'
DefuzzMethod='centroid'

[Input1]
Name='service'
Range=[0 10]
NumMFs=3
MF1='poor':'gaussmf',[1.5 0]
MF2='good':'gaussmf',[1.5 5]
MF3='excellent':'gaussmf',[1.5 10]

[Input2]
Name='food'
Range=[0 10]
NumMFs=2
MF1='rancid':'trapmf',[0 0 1 3]
MF2='delicious':'trapmf',[7 9 10 10]

[Output1]
Name='tip'
Range=[0 30]
NumMFs=3
MF1='cheap':'trimf',[0 5 10]
MF2='average':'trimf',[10 15 20]
MF3='generous':'trimf',[20 25 30]

[Rules]
1 1, 1 (1) : 2
2 0, 2 (1) : 1
3 2, 3 (1) : 2
"""
"""The example of MATLAB's Fuzzy Logic Toolbox, whose documentation gives its outputs."""


def random_set(rng, low, high, kind):
    """A set of some kind whose interesting part lies in the range."""
    width = high - low
    corners = np.sort(rng.uniform(low - 0.1 * width, high + 0.1 * width, 4))
    centre = rng.uniform(low, high)
    numbers = {
        "trimf": corners[:3],
        "trapmf": corners,
        "gaussmf": (rng.uniform(0.05, 0.4) * width, centre),
        "gbellmf": (rng.uniform(0.1, 0.4) * width, rng.uniform(1.0, 4.0), centre),
        "sigmf": (rng.choice([-1, 1]) * rng.uniform(5, 40) / width, centre),
        "linsmf": corners[:2],
        "linzmf": corners[:2],
        "smf": corners[:2],
        "zmf": corners[:2],
        "pimf": corners,
        "gauss2mf": (0.1 * width, corners[1], rng.uniform(0.05, 0.4) * width, corners[2]),
        "dsigmf": (rng.uniform(10, 40) / width, corners[0], rng.uniform(10, 40) / width, corners[2]),
        "psigmf": (rng.uniform(10, 40) / width, corners[0], -rng.uniform(10, 40) / width, corners[2]),
    }[kind]
    return MEMBERSHIPS[kind](*(as_number(number) for number in numbers))


def random_variable(rng, name):
    low = rng.uniform(-5, 0)
    high = low + rng.uniform(0.5, 10)
    count = int(rng.integers(2, 5))
    kinds = rng.choice(list(MEMBERSHIPS), count)
    sets = tuple(random_set(rng, low, high, kind) for kind in kinds)
    return Variable(name, as_number(low), as_number(high), tuple(f"s{i}" for i in range(count)), sets)


def random_system(seed, points=1001, norms=None, defuzzifier=None):
    """A Mamdani system of one to three inputs with random sets and rules."""
    rng = np.random.default_rng(seed)
    inputs = tuple(random_variable(rng, f"in{i}") for i in range(rng.integers(1, 4)))
    output = random_variable(rng, "out")
    rules = []
    for _ in range(rng.integers(2, 7)):
        used = np.flatnonzero(rng.random(len(inputs)) < 0.7)
        used = used if len(used) else [0]
        before = tuple(Clause(int(i), int(rng.integers(len(inputs[i].sets))), bool(rng.random() < 0.15)) for i in used)
        after = (Clause(0, int(rng.integers(len(output.sets)))),)
        rules.append(Rule(before, after, as_number(rng.uniform(0.3, 1.0)), bool(rng.random() < 0.3)))
    conjunction, disjunction, implication, aggregation = norms or (
        rng.choice([Minimum(), Product()]),
        rng.choice([Maximum(), ProbabilisticSum()]),
        rng.choice([Minimum(), Product()]),
        rng.choice([Maximum(), Sum(), ProbabilisticSum()]),
    )
    system = Mamdani(
        inputs,
        (output,),
        tuple(rules),
        conjunction,
        disjunction,
        implication,
        aggregation,
        defuzzifier or Centroid(),
        points,
    )
    lows = np.array([float(v.low) for v in inputs])
    highs = np.array([float(v.high) for v in inputs])
    values = jnp.asarray(rng.uniform(lows - 0.2, highs + 0.2))
    return system, values


_NAMES = ("NB", "nb", "Nb", "not", "is", "then", "don't", "''", "a b", " a", "x.", "(p)", "50 %", "# 1", "[Rules]", "=")
_SIGNS = "aZ '\"%#=:,;()[]{}.\\-_\t\u00e9\u0130\u03c8\u670d\u2028\x85"


def _any_names(rng, count):
    """Different names, among them such as files and sentences trip over; many are equal but for case."""
    found = []
    while len(found) < count:
        own = "".join(rng.choice(list(_SIGNS), rng.integers(0, 6)))
        name = str(rng.choice(_NAMES)) if rng.random() < 0.6 else own
        if name not in found:
            found.append(name)
    return found


def any_system(rng, inputs=None):
    """A random Mamdani system that a file can hold, with any names; those of its inputs may be given.

    Its rules have their clauses in the order of the variables, as those of `.fis` files do.
    """

    def variable(name):
        low = rng.choice([-1e13, -45.0, -1.0, 0.0, 1e-10])
        high = low + rng.choice([1.0, 1e-11, 1 / 3]) * max(1e-3, abs(low))
        kinds = rng.choice(list(MEMBERSHIPS), rng.integers(1, 5))
        sets = [random_set(rng, low, high, kind) for kind in kinds]
        open_ = MEMBERSHIPS["trapmf"](*map(as_number, (-np.inf, -np.inf, low, rng.uniform(low, high))))
        sets = (*sets, open_) if rng.random() < 0.3 else tuple(sets)
        return Variable(name, as_number(low), as_number(high), tuple(_any_names(rng, len(sets))), sets)

    names = inputs or _any_names(rng, rng.integers(1, 4))
    ins = tuple(variable(name) for name in names)
    outs = tuple(variable(name) for name in _any_names(rng, 1 if inputs else rng.integers(1, 3)))

    def clauses(variables):
        chosen = sorted(rng.choice(len(variables), rng.integers(1, len(variables) + 1), replace=False))
        return tuple(
            Clause(int(v), int(rng.integers(len(variables[v].labels))), bool(rng.random() < 0.3)) for v in chosen
        )

    rules = []
    for _ in range(rng.integers(1, 6)):
        before = clauses(ins)
        weight = as_number(rng.choice([0.0, 1.0, 1 / 3, 5e-324]))
        rules.append(Rule(before, clauses(outs), weight, bool(rng.random() < 0.5) and len(before) > 1))
    return Mamdani(
        ins,
        outs,
        tuple(rules),
        rng.choice([Minimum, Product])(),
        rng.choice([Maximum, ProbabilisticSum])(),
        rng.choice([Minimum, Product])(),
        rng.choice([Maximum, Sum, ProbabilisticSum])(),
        DEFUZZIFIERS[rng.choice(list(DEFUZZIFIERS))](),
        matlab=bool(rng.random() < 0.5),
    )
