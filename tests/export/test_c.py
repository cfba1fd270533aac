"""Headers in C99, compiled with gcc, against the Python controllers that they come from."""

import dataclasses
import itertools
import re
import shutil
import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge import InputError
from jbridge.control.compensation import Compensation
from jbridge.control.extended_rules import extended_controller
from jbridge.control.files import Controller
from jbridge.control.linear import ObserverFeedback, Pid, StateFeedback
from jbridge.control.paper_rules import paper_controller
from jbridge.control.shaping import Shaping
from jbridge.export.c import TOLERANCES, controller_header, samples
from jbridge.export.c_fuzzy import HELPERS, system_source
from jbridge.fuzzy.defuzzify import DEFUZZIFIERS
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.norms import Maximum, Minimum, ProbabilisticSum, Product, Sum
from jbridge.fuzzy.rules import Clause, Rule, Variable, as_number
from jbridge.fuzzy.sugeno import Conclusions, Linear, Sugeno
from tests.export.c_compiler import compiled
from tests.fuzzy.systems import random_set

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")

COUNT = 100_000
LAWS = {
    "paper": paper_controller(),
    "extended": extended_controller(Compensation(cart=0.3, hoist=0.8, hoist_bias=-0.5)),
    "pid": Pid(cart_i=2.0, compensation=Compensation(cart=0.3, hoist_bias=-0.5)),
    "lqg": ObserverFeedback(
        jnp.array([[12.0, -3.0, 1.0, 3.0, -0.5, 0.1], [0.5, 0.2, 40.0, 0.1, 0.0, 3.0]]),
        jnp.eye(6).at[:3, 3:].set(0.02 * jnp.eye(3)).at[3:, 3:].set(0.8 * jnp.eye(3)).at[4, 1].set(-0.4),
        jnp.array([[5e-4, 0.0], [1e-4, 0.0], [0.0, 3e-4], [0.05, 0.0], [0.02, 0.0], [0.0, 0.03]]),
        jnp.concatenate([0.8 * jnp.eye(3), 10.0 * jnp.eye(3)]).at[4, 0].set(0.7),
        Compensation(cart=0.3, hoist=0.8, hoist_bias=-0.5),
    ),
    "lqr": StateFeedback(jnp.array([[9.0, -3.0, 1.0, 2.0, -0.5, 0.1], [0.5, 0.2, 40.0, 0.1, 0.0, 3.0]])),
}
LOOP = """
#include <stdio.h>
int main(void) {
    double row[7];
    P_real measured[3], reference[4], command[2];
    static P_state state;
    int k, first = 1;
    while (fread(row, sizeof row, 1, stdin) == 1) {
        for (k = 0; k < 3; ++k) measured[k] = (P_real)row[k];
        for (k = 0; k < 4; ++k) reference[k] = (P_real)row[3 + k];
        if (first) P_start(&state, measured);
        first = 0;
        P_step(&state, measured, reference, command);
        for (k = 0; k < 2; ++k) row[k] = command[k];
        fwrite(row, sizeof *row, 2, stdout);
    }
    return 0;
}
"""


@pytest.mark.parametrize("name", LAWS)
def test_controllers_command_the_same_in_c(tmp_path, name):
    """Over a hundred thousand samples of a walk, in double precision to 1e-12 V, and as stated in single precision."""
    controller = Controller(LAWS[name], 0.02)
    header = controller_header(controller, name)
    measured, reference, wanted = samples(controller, COUNT, seed=1)
    assert np.ptp(wanted[:, 0]) > 3.0 and np.ptp(wanted[:, 1]) > 5.0
    rows = np.concatenate([measured, reference], axis=1).tobytes()
    for kind in ("double", "float"):
        program = compiled(tmp_path, header + LOOP.replace("P_", f"{name}_"), f"-D{name.upper()}_REAL={kind}")
        found = np.frombuffer(subprocess.run([program], input=rows, capture_output=True, check=True).stdout)
        assert np.max(np.abs(found.reshape(-1, 2) - wanted)) <= TOLERANCES[kind]
        # Single precision is not bought by computing in double precision.
        assert np.max(np.abs(found.reshape(-1, 2) - wanted)) > 1e-9 or kind == "double"


def test_a_header_tests_itself(tmp_path):
    header = controller_header(Controller(LAWS["extended"]), "crane")
    assert subprocess.run([compiled(tmp_path, header, "-DCRANE_MAIN")], check=False).returncode == 0
    # A constant of the controller that has been changed is noticed.
    scale = "(reference[0] - measured[0]) / crane_C(0.4)"
    assert scale in header
    broken = compiled(tmp_path, header.replace(scale, scale.replace("0.4", "0.41")), "-DCRANE_MAIN")
    assert subprocess.run([broken], capture_output=True, check=False).returncode == 1
    assert not re.search(r"\b(malloc|calloc|realloc|free)\b", header)


@pytest.mark.parametrize("shaping", [Shaping("zv", 4.4), Shaping("zvd", 4.4, 0.1), Shaping("zv", np.pi / 0.4)])
def test_a_shaped_reference_is_shaped_in_c(tmp_path, shaping):
    """Delays of 35.7 samples, of 35.9 and 71.8, and of 20 on the sample."""
    controller = Controller(LAWS["pid"], 0.02, shaping=shaping)
    header = controller_header(controller, "crane")
    measured, reference, wanted = samples(controller, 2000, seed=1)
    plain = samples(Controller(LAWS["pid"], 0.02), 2000, seed=1)[2]
    assert np.median(np.abs(plain - wanted)[:, 0]) > 0.1
    rows = np.concatenate([measured, reference], axis=1).tobytes()
    # Over 40 s NumPy's interpolation rounds times to 7e-15 s, at references that jump by 50 m/s and 10 V/m.
    for kind, tolerance in (("double", 1e-11), ("float", TOLERANCES["float"])):
        program = compiled(tmp_path, header + LOOP.replace("P_", "crane_"), f"-DCRANE_REAL={kind}")
        found = np.frombuffer(subprocess.run([program], input=rows, capture_output=True, check=True).stdout)
        assert np.max(np.abs(found.reshape(-1, 2) - wanted)) <= tolerance
        assert subprocess.run([compiled(tmp_path, header, f"-DCRANE_REAL={kind}", "-DCRANE_MAIN")]).returncode == 0
    broken = header.replace("weight[k] * then[0]", "weight[k] * wanted[0]")
    assert subprocess.run([compiled(tmp_path, broken, "-DCRANE_MAIN")], capture_output=True).returncode == 1


def some_system(rng, kinds, defuzzifier, *, matlab):
    """A Mamdani system of two inputs, a set of each kind in every variable, some negated clauses, all norms."""

    def variable(name):
        sets = tuple(random_set(rng, -1.0, 2.0, kind) for kind in kinds)
        return Variable(name, as_number(-1.0), as_number(2.0), tuple(map(str, range(len(kinds)))), sets)

    x, y, z = (variable(name) for name in "xyz")
    rules = []
    for place in range(len(kinds)):
        other = int(rng.integers(len(kinds)))
        before = (Clause(0, place), Clause(1, other, bool(rng.random() < 0.3)))
        weight = as_number(rng.choice([1.0, 0.3]))
        rules.append(Rule(before, (Clause(0, other, bool(rng.random() < 0.2)),), weight, bool(rng.random() < 0.4)))
    norms = rng.choice([Minimum, Product])(), rng.choice([Maximum, ProbabilisticSum])()
    ways = rng.choice([Minimum, Product])(), rng.choice([Maximum, Sum, ProbabilisticSum])()
    return Mamdani((x, y), (z,), tuple(rules), *norms, *ways, DEFUZZIFIERS[defuzzifier](), matlab=matlab)


STRAIGHT, CURVED = (
    ["trimf", "trapmf", "linsmf", "linzmf", "smf", "zmf", "pimf"],
    ["gaussmf", "gauss2mf", "gbellmf", "sigmf", "dsigmf", "psigmf", "trapmf"],
)
SYSTEMS = list(itertools.product((STRAIGHT, CURVED), DEFUZZIFIERS, (False, True)))


@pytest.mark.parametrize(
    "chosen", [SYSTEMS[3:18:7], pytest.param(SYSTEMS, marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_fuzzy_systems_infer_the_same_in_c(tmp_path, chosen):
    """Every kind of set and way to defuzzify, also beyond the universes.

    Where degrees of curved sets differ by rounding, the mean, the smallest and the largest of maximum and the bisector
    may choose the next point of the grid: that may happen once in a thousand.
    """
    rng = np.random.default_rng(0)
    systems = [some_system(rng, kinds, name, matlab=matlab) for kinds, name, matlab in chosen]
    values = rng.uniform(-1.5, 2.5, (2_000, 2))
    functions = "".join(system_source(f"s{k}", system) for k, system in enumerate(systems))
    text = "#include <math.h>\n#include <stdio.h>\n#define R(value) (value)\ntypedef double P_real;\n"
    calls = "".join(f"result[{k}] = P_s{k}(row); " for k in range(len(systems)))
    text += f"{HELPERS}{functions}int main(void) {{ double row[2], result[{len(systems)}];\n"
    text += "while (fread(row, sizeof row, 1, stdin) == 1) {\n"
    text += f"{calls}fwrite(result, sizeof result, 1, stdout); }} return 0; }}\n"
    program = compiled(tmp_path, text)
    out = subprocess.run([program], input=values.tobytes(), capture_output=True, check=True).stdout
    found = np.frombuffer(out).reshape(len(values), -1)
    for k, system in enumerate(systems):
        wanted = jax.jit(jax.vmap(lambda v, system=system: system.infer(v).output[0]))(jnp.asarray(values))
        away = np.abs(found[:, k] - np.asarray(wanted))
        assert np.ptp(wanted) > 0.1
        allowed = 0.0 if system.defuzzifier.name == "centroid" else 1e-3
        assert np.mean(away > 1e-12) <= allowed, (chosen[k], np.sum(away > 1e-12), away.max())


def test_an_input_without_sets_has_no_array(tmp_path):
    """An array of no elements is no C99: an input of a Sugeno system may stand in its functions alone."""
    x, y, z = (Variable(n, as_number(-1.0), as_number(1.0), (), ()) for n in ("error", "velocity", "angle"))
    x = dataclasses.replace(x, labels=("P",), sets=(random_set(np.random.default_rng(0), -1.0, 1.0, "trimf"),))
    output = Conclusions("u", as_number(-3.0), as_number(3.0), ("a",), (Linear(np.array([2.0, 1.0, 0.0]), 0.1),))
    cart = Sugeno((x, y, z), (output,), (Rule((Clause(0, 0),), (Clause(0, 0),), as_number(1.0), False),))
    header = controller_header(Controller(dataclasses.replace(paper_controller(), cart=cart)), "crane")
    assert subprocess.run([compiled(tmp_path, header, "-DCRANE_MAIN")], capture_output=True).returncode == 0


def test_single_precision_computes_in_single_precision(tmp_path):
    """Nothing is promoted to double, which small machines compute slowly, and no type-generic library is needed."""
    header = controller_header(Controller(LAWS["extended"]), "crane")
    strict = ("-DCRANE_REAL=float", "-DCRANE_MAIN", "-Wdouble-promotion", "-Wconversion", "-Wno-sign-conversion")
    compiled(tmp_path, header, *strict)
    assert set(re.findall("#include <(.*)>", header)) == {"math.h", "stdio.h"}


def test_sugeno_systems_infer_the_same_in_c(tmp_path):
    rng = np.random.default_rng(1)
    before = some_system(rng, STRAIGHT, "centroid", matlab=False)
    functions = tuple(Linear(rng.standard_normal(2) * (k % 2), rng.standard_normal()) for k in range(7))
    output = Conclusions("z", as_number(0.0), as_number(1.0), tuple("abcdefg"), functions)
    rules = tuple(Rule(r.antecedent, (Clause(0, k),), r.weight, r.any_of) for k, r in enumerate(before.rules))
    values = rng.uniform(-1.5, 2.5, (1_000, 2))
    for summed in (False, True):
        system = Sugeno(before.inputs, (output,), rules, summed=summed)
        text = "#include <math.h>\n#include <stdio.h>\n#define R(value) (value)\ntypedef double P_real;\n"
        text += HELPERS + system_source("s", system)
        text += "int main(void) { double row[2], result; while (fread(row, sizeof row, 1, stdin) == 1) {\n"
        text += "result = P_s(row); fwrite(&result, sizeof result, 1, stdout); } return 0; }\n"
        out = subprocess.run([compiled(tmp_path, text)], input=values.tobytes(), capture_output=True, check=True)
        wanted = jax.jit(jax.vmap(lambda v, s=system: s.infer(v).output[0]))(jnp.asarray(values))
        np.testing.assert_allclose(np.frombuffer(out.stdout), wanted, atol=1e-12)


def test_what_has_no_form_in_c_is_refused():
    with pytest.raises(InputError, match="'2 b' is no name in C"):
        controller_header(Controller(Pid()), "2 b")
