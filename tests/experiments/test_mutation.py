"""Changes of code for which tests are tried: one place each, all of them Python, none in text or annotations."""

import ast
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))

import mutation

SOURCE = '''\
"""1 < 2"""
from math import pi

LIMIT: "2 + 2" = 3


def larger(a: int, b: "1 < 2", ready=True) -> "3 > 2":
    """Not -a."""
    rest = a - b
    if rest > LIMIT and ready:
        rest = -rest * 0.5
        raise ValueError(f"{a + b} is 5")
    print(rest)
    return "1" if rest in (1, 2) else rest
'''


def test_changes_by_hand():
    found = {change.name for change in mutation.changes(SOURCE)}
    assert found == {
        "4: 3 -> (4)",
        "7: True -> (False)",
        "9: rest = a - b -> pass",
        "9: a - b -> (a + b)",
        "10: rest > LIMIT and ready -> (not (rest > LIMIT and ready))",
        "10: rest > LIMIT and ready -> (rest > LIMIT or ready)",
        "10: rest > LIMIT -> (rest >= LIMIT)",
        "10: rest > LIMIT -> (rest <= LIMIT)",
        "11: rest = -rest * 0.5 -> pass",
        "11: -rest * 0.5 -> (-rest / 0.5)",
        "11: -rest -> (rest)",
        "11: 0.5 -> (1.0)",
        '12: raise ValueError(f"{a + b} is 5") -> pass',
        "13: print(rest) -> pass",
        '14: return "1" if rest in (1, 2) else rest -> return None',
        "14: rest in (1, 2) -> (not (rest in (1, 2)))",
        "14: rest in (1, 2) -> (rest not in (1, 2))",
        "14: 1 -> (2)",
        "14: 2 -> (3)",
    }


def test_changes_of_the_package_are_python():
    for module in mutation.MODULES:
        source = (mutation.ROOT / "jbridge" / f"{module}.py").read_text()
        chosen = mutation.sample(module, source)
        assert len(chosen) == mutation.COUNT
        same = ast.dump(ast.parse(source))
        for change in chosen:
            assert ast.dump(ast.parse(change.source)) != same
    assert chosen == mutation.sample(module, source)
