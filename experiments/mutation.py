"""Would the tests notice? Small changes to the code that results hang on, and its tests over each of them.

    python experiments/mutation.py                       all modules: an hour
    python experiments/mutation.py dry_friction fis_reader      some of them
    python experiments/mutation.py --survivors           again what no test noticed
    python experiments/mutation.py --figures             the table from the kept numbers

Of each module thirty changes are drawn from all places: another operator, comparison or constant, a condition turned
round, a statement left out. Text and annotations stay. A change is killed if a test of the module fails, or takes five
times as long as all of them did. Each runs in a process forked from one that has imported libraries and nothing of
jbridge: mutmut forks after the tests were collected, when JAX has threads, and cosmic-ray pays for every start.
Why a survivor stays is written by hand in figures/data/mutation-reasons.toml.
"""

import argparse
import ast
import contextlib
import copy
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DATA, TABLE = ROOT / "figures" / "data" / "mutation.json", ROOT / "figures" / "mutation-table.md"
REASONS = ROOT / "figures" / "data" / "mutation-reasons.toml"
MODULES = {
    "model/dry_friction": ["tests/model/effects/test_friction.py"],
    "identification/likelihood": ["tests/identification/test_likelihood.py"],
    "identification/uncertainty": ["tests/identification/test_uncertainty.py"],
    # The others, of gradients and of hundreds of systems, take minutes.
    "fuzzy/inference": ["tests/fuzzy/test_inference.py", "-k", "not gradient and not derivative and not thousand"],
    "fuzzy/files/fis_reader": ["tests/fuzzy/test_fis.py"],
    "control/fuzzy_files": ["tests/control/test_files.py"],
    "model/files": ["tests/model/test_files.py"],
    "recordings/sidecar": ["tests/recordings/test_sidecar.py"],
    "recordings/tables/clock": ["tests/recordings/test_wrong_data.py", "tests/recordings/test_slips.py"],
    # The others, of units and signs, take longer than a minute.
    "recordings/tables/csv_lines": [
        "tests/recordings/test_wrong_data.py", "tests/recordings/test_slips.py", "tests/recordings/test_refusals.py",
        "-k", "not mends and not unit_of_the_header and not exchanged_columns",
    ],
    "recordings/tables/csv_table": ["tests/recordings/test_refusals.py", "tests/recordings/test_load.py"],
    "recordings/tables/mat_format": ["tests/recordings/test_mat.py"],
    "recordings/tables/mat_table": ["tests/recordings/test_mat.py"],
}  # fmt: skip
"""Tests by module of the package."""
COUNT, SEED, MEMORY = 30, 0, 8 * 2**30
SWAPPED: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.FloorDiv: (ast.Div,), ast.Mod: (ast.Mult,), ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,),
    ast.MatMult: (ast.Mult,),
}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One change of a module's text."""

    line: int
    before: str
    after: str
    source: str
    """The module with it."""

    @property
    def name(self) -> str:
        return f"{self.line}: {self.before} -> {self.after}"


def changes(source: str) -> list[Change]:
    """All single changes of a module."""
    found = []
    lines = source.encode().splitlines(keepends=True)
    for node, text in _places(ast.parse(source)):
        begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
        end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
        whole = b"".join(lines)
        before = " ".join(whole[begin:end].decode().split())
        found.append(Change(node.lineno, before, text, (whole[:begin] + text.encode() + whole[end:]).decode()))
    return found


def _places(tree: ast.AST) -> Iterator[tuple[Any, str]]:
    """Nodes of a module and what may stand there instead."""
    bound = Counter(
        part.id for part in ast.walk(tree) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
    )
    for node in _code(tree):
        if isinstance(node, ast.If | ast.While | ast.IfExp):
            yield node.test, f"(not ({ast.unparse(node.test)}))"
        elif isinstance(node, ast.stmt):
            yield from ((node, text) for text in _other_statements(node, bound))
        elif isinstance(node, ast.expr):
            for other in _others(node):
                yield node, f"({ast.unparse(other)})"


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """What computes: neither text, whose parts have no places in Python 3.11, nor annotations, decorators, imports."""
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list", "bases"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _code(child)


def _others(node: ast.expr) -> Iterator[ast.expr]:
    """Other expressions for one."""
    if isinstance(node, ast.UnaryOp):
        yield node.operand
    if isinstance(node, ast.BinOp | ast.BoolOp):
        for swapped in SWAPPED.get(type(node.op), ()):
            changed: Any = copy.deepcopy(node)
            changed.op = swapped()
            yield changed
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            for swapped in SWAPPED.get(type(operator), ()):
                changed = copy.deepcopy(node)
                changed.ops[place] = swapped()
                yield changed
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        whole = isinstance(node.value, int)
        yield ast.Constant(node.value + 1 if whole or node.value == 0.0 else 2.0 * node.value)


def _other_statements(node: ast.stmt, bound: Counter[str]) -> Iterator[str]:
    """What may stand instead of a statement, but for one that alone binds a name: without that Python complains.

    Args:
        bound: how often the module binds each name.
    """
    if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
        yield "return None"
    elif isinstance(node, ast.Raise | ast.Continue | ast.Break | ast.AugAssign):
        yield "pass"
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "pass"
    elif isinstance(node, ast.Assign):
        names = {part.id for target in node.targets for part in ast.walk(target) if isinstance(part, ast.Name)}
        if all(bound[name] > 1 for name in names):
            yield "pass"


def sample(module: str, source: str) -> list[Change]:
    """The changes of a module that are tried, by line; the same in every run."""
    every = changes(source)
    return sorted(random.Random(f"{SEED} {module}").sample(every, min(COUNT, len(every))), key=lambda c: c.line)


def outcome(tree: Path, tests: list[str], limit: float) -> str:
    """`passed`, `failed` or `late`: what the tests of a module say of a copy of the project.

    Raises:
        RuntimeError: pytest finds no tests, or is called wrongly.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX, which has started nothing here
        child = os.fork()
    if child == 0:
        _test(tree, tests)
    begun = time.monotonic()
    while time.monotonic() - begun < limit:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            if code in (4, 5):
                raise RuntimeError(f"pytest: exit status {code}: {(tree / 'said.txt').read_text()[-500:]}")
            return "failed" if code else "passed"
        time.sleep(0.05)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "late"


def _test(tree: Path, tests: list[str]) -> None:
    """Runs tests in this process, which ends with pytest's status."""
    code = 70
    try:
        os.setsid()
        os.chdir(tree)
        sys.path.insert(0, str(tree))
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.RLIM_INFINITY))
        with open("said.txt", "wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        import pytest

        # Plugins that libraries bring along were imported with them.
        options = ["-W", "ignore::pytest.PytestAssertRewriteWarning", "-p", "no:cacheprovider", "-p", "no:xdist"]
        code = int(pytest.main(["-q", "-x", "-m", "not slow", *options, *tests]))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def copied(folder: Path) -> Path:
    """A copy of what tests need."""
    tree = folder / "tree"
    for name in ("jbridge", "tests", "experiments", "docs", "figures"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, tree / name)
    return tree


def tried(tree: Path, module: str, names: set[str] | None) -> dict[str, Any]:
    """What the tests make of the changes of one module, or of those with some names."""
    path, tests = tree / "jbridge" / f"{module}.py", MODULES[module]
    source = path.read_text()
    begun = time.monotonic()
    if outcome(tree, tests, 1200.0) != "passed":
        raise RuntimeError(f"{module}: its tests fail without any change: {(tree / 'said.txt').read_text()[-2000:]}")
    limit, chosen = 5.0 * (time.monotonic() - begun) + 10.0, sample(module, source)
    survivors = []
    for number, change in enumerate(chosen if names is None else [c for c in chosen if c.name in names]):
        path.write_text(change.source)
        os.utime(path, (number + 1, number + 1))  # compiled files go by the second
        if outcome(tree, tests, limit) == "passed":
            survivors.append(change.name)
            print(f"{module}:{change.name}", flush=True)
        shutil.rmtree(tree.parent / "cache" / "jbridge" / "programs", ignore_errors=True)
    path.write_text(source)
    print(f"{module}: {len(chosen) - len(survivors)} of {len(chosen)} killed", flush=True)
    return {"tests": tests, "places": len(changes(source)), "changed": len(chosen), "survivors": survivors}


def table(kept: dict[str, Any], reasons: dict[str, dict[str, str]]) -> str:
    lines = [
        "# Mutation", "",
        "Modules with one small change each (an operator, comparison or constant, a condition turned round, a",
        "statement left out), thirty drawn from all places of a module, under its tests alone. Killed: a test failed.",
        "Equivalent: no test could fail, for the reason below. Share: killed, of those that are not equivalent.",
        "Redrawn by `python experiments/mutation.py --figures`; do not edit.", "",
        "| module | places | changed | killed | equivalent | share |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    counts, total = {}, [0, 0, 0, 0]
    for module in (module for module in MODULES if module in kept):
        row, known = kept[module], reasons.get(module, {})
        alike = sum(known.get(name, "").startswith("Equivalent") for name in row["survivors"])
        counts[module] = [row["places"], row["changed"], row["changed"] - len(row["survivors"]), alike]
        total = [a + b for a, b in zip(total, counts[module], strict=True)]
    for name, (places, changed, killed, alike) in [*counts.items(), ("all", total)]:
        share = f"{100 * killed / max(changed - alike, 1):.0f} %"
        lines.append(f"| {name} | {places} | {changed} | {killed} | {alike} | {share} |")
    lines += ["", "| survivor | line and change | why |", "|---|---|---|"]
    for module in counts:
        for name in kept[module]["survivors"]:
            shown = " ".join(name.split()).replace("|", "\\|")
            lines.append(f"| {module} | `{shown}` | {reasons.get(module, {}).get(name, '')} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", help="by the end of their names (default: all)")
    parser.add_argument("--survivors", action="store_true", help="only changes that survived in the last run")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    chosen = parser.parse_args()
    kept = json.loads(DATA.read_text()) if DATA.exists() else {}
    if not chosen.figures:
        os.environ.update(OPENBLAS_NUM_THREADS="1", MPLBACKEND="Agg")
        for name in ("beartype", "diffrax", "hypothesis", "matplotlib.pyplot", "optax", "pyarrow.parquet", "pytest"):
            __import__(name)
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = f"{folder}/cache"
            tree = copied(Path(folder))
            for module in MODULES:
                if chosen.survivors and module not in kept:
                    continue
                if not chosen.modules or module.endswith(tuple(chosen.modules)):
                    again = set(kept[module]["survivors"]) if chosen.survivors else None
                    kept[module] = tried(tree, module, again)
                    DATA.write_text(json.dumps(kept, indent=1) + "\n")
    TABLE.write_text(table(kept, tomllib.loads(REASONS.read_text()) if REASONS.exists() else {}))


if __name__ == "__main__":
    main()
