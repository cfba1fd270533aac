"""Holds the layers: imports in `jbridge` point down the list below, never up or sideways, and none go in a circle.

Only the syntax is read, so that an import inside a function or under `TYPE_CHECKING` counts like any other there.
"""

import ast
import importlib
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import packages_distributions
from pathlib import Path, PurePath
from types import ModuleType
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]

LAYERS = (
    {"_display", "_progress", "compilation"},
    {"_math", "_types", "_version", "errors"},
    {"_files", "_toml", "dask_workers"},
    {"recordings", "trajectory"},
    {"model", "fuzzy"},
    {"control"},
    {"simulation"},
    {"identification"},
    {"diagnosis", "prediction", "tuning"},
    {"export", "sweep"},
    {"report"},
    {"cli"},
    {"__main__"},
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
FACE = "__init__"


class Import(NamedTuple):
    """`from module import name`, or `import module` where `name` is empty."""

    line: int
    module: str
    name: str = ""

    def target(self) -> str:
        """Returns the top-level module of jbridge that is meant, or its public face."""
        parts = [*self.module.split("."), self.name]
        return parts[1] if parts[1] in LEVEL or len(parts) > 2 else FACE


def imports(path: PurePath, source: str, *, at_once: bool = False) -> Iterator[Import]:
    """Yields what a file imports, or what it imports when it is loaded, with relative names resolved; `path` is
    relative to the root."""
    package, tree = path.parts[:-1], ast.parse(source, str(path))
    for node in tree.body if at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (Import(node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from (Import(node.lineno, module, alias.name) for alias in node.names)


def is_ours(found: Import) -> bool:
    return found.module.split(".")[0] == "jbridge"


def upward_imports(path: PurePath, source: str) -> list[str]:
    """Returns one complaint per import of a jbridge file that does not point down the list."""
    importer = path.with_suffix("").parts[1]
    if importer != FACE and importer not in LEVEL:
        return [f"{path}: {importer} has no layer; give it one in LAYERS"]
    complaints = []
    for found in filter(is_ours, imports(path, source)):
        target, where = found.target(), f"{path}:{found.line}"
        if target == importer:
            continue
        if target not in {FACE, *LEVEL}:
            complaints.append(f"{where}: imports {target}, which has no layer")
        elif importer == "cli":
            if found.module != "jbridge":
                complaints.append(f"{where}: cli imports {target} instead of the public face")
        elif importer == FACE:
            if LEVEL[target] >= LEVEL["cli"]:
                complaints.append(f"{where}: the public face imports {target}")
        elif target == FACE:
            if LEVEL[importer] < LEVEL["cli"]:
                complaints.append(f"{where}: {importer} imports the public face, which lies above it")
        elif LEVEL[target] >= LEVEL[importer]:
            direction = "up" if LEVEL[target] > LEVEL[importer] else "sideways"
            complaints.append(f"{where}: {importer} imports {direction}, from {target}")
    return complaints


def circles(files: Iterable[tuple[PurePath, str]]) -> list[str]:
    """Returns one complaint per package whose modules and packages need each other to be loaded."""
    needs: defaultdict[str, defaultdict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for path, source in files:
        importer = path.with_suffix("").parts
        for found in filter(is_ours, imports(path, source, at_once=True)):
            target = (*found.module.split("."), found.name)
            same = [a == b for a, b in zip(importer, target, strict=False)]
            shared = (*same, False).index(False)
            if shared < min(len(importer), len(target)):
                needs[".".join(importer[:shared])][importer[shared]].add(target[shared])
    out = []
    for package, graph in needs.items():
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            out.append(f"{package}: {' -> '.join(error.args[1])}")
    return out


def private_imports(path: PurePath, source: str) -> list[str]:
    """Returns one complaint per import that reaches behind jbridge's public face."""
    ours = filter(is_ours, imports(path, source))
    return [f"{path}:{found.line}: imports {found.module}" for found in ours if found.module != "jbridge"]


def sources(folder: str) -> Iterator[tuple[PurePath, str]]:
    for path in sorted([*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.pyi")]):
        yield path.relative_to(ROOT), path.read_text(encoding="utf-8")


def test_imports_point_down():
    assert [line for path, source in sources("jbridge") for line in upward_imports(path, source)] == []


def test_layers_are_those_of_the_disk():
    folder = ROOT / "jbridge"
    packages = {path.name for path in folder.iterdir() if (path / "__init__.py").exists()}
    assert {*packages, *(path.stem for path in folder.glob("*.py"))} - {FACE} == LEVEL.keys()


def test_packages_have_no_circles():
    assert circles(sources("jbridge")) == []


def test_a_circle_is_found():
    files = {
        "jbridge/model/bridge.py": "from .effects.base import Seed",
        "jbridge/model/effects/base.py": "from ..bridge import Bridge\nfrom .friction import Coulomb",
        "jbridge/model/effects/friction.py": "def late():\n    from .base import Seed",
    }
    (found,) = circles((PurePath(path), source) for path, source in files.items())
    assert found.startswith("jbridge.model: ") and "effects" in found


def opens_holdout(path: PurePath, source: str) -> list[str]:
    """Returns one complaint per line by which a module other than the validation could open a hold-out."""
    complaints = []
    if path.name not in ("diagnose.py", "validate.py", "holdout.py"):
        known = [found for found in imports(path, source) if found.name == "HoldOut"]
        complaints += [f"{path}:{found.line}: knows the hold-out" for found in known]
    for node in ast.walk(ast.parse(source)):
        opened = isinstance(node, ast.Attribute) and node.attr in ("open", "_recordings")
        if opened and path.name not in ("validate.py", "holdout.py"):
            complaints.append(f"{path}:{node.lineno}: opens the hold-out")
    return complaints


def test_the_validation_alone_opens_the_hold_out():
    chosen = [*sources("jbridge/diagnosis"), *sources("jbridge/identification")]
    assert [line for path, source in chosen for line in opens_holdout(path, source)] == []


@pytest.mark.parametrize(
    "source", ["from .holdout import HoldOut", "runs = sealed.open()", "runs = problem.setting.holdout._recordings"]
)
def test_what_opens_a_hold_out_would_be_found(source):
    assert len(opens_holdout(PurePath("jbridge/diagnosis/selection/search.py"), source)) == 1


def test_experiments_use_the_public_face():
    assert [line for path, source in sources("experiments") for line in private_imports(path, source)] == []


def test_experiments_use_public_names():
    used = {
        found.name: path
        for path, source in sources("experiments")
        for found in filter(is_ours, imports(path, source))
        if found.name
    }
    public = set(importlib.import_module("jbridge").__all__) if used else set()
    assert {name: path for name, path in used.items() if name not in public} == {}


def test_public_names_are_not_hidden_by_modules():
    """Loading a `jbridge.simulate` binds that module in `jbridge`, where a lazy face offers the function."""
    face = importlib.import_module("jbridge")
    shared = LEVEL.keys() & getattr(face, "__all__", ())
    for name in shared:
        importlib.import_module(f"jbridge.{name}")
    assert [name for name in shared if isinstance(getattr(face, name), ModuleType)] == []


def test_every_import_is_a_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    # What an extra brings is imported where it is asked for, within a function.
    entries = [*project["dependencies"], *project["optional-dependencies"]["cluster"]]
    declared = {re.split(r"[^\w.-]", entry)[0].lower().replace("_", "-") for entry in entries}
    providers = packages_distributions()
    missing = [
        f"{path}:{found.line}: {top}"
        for path, source in sources("jbridge")
        for found in imports(path, source)
        if (top := found.module.split(".")[0]) not in {"jbridge", *sys.stdlib_module_names}
        and declared.isdisjoint(name.lower().replace("_", "-") for name in providers.get(top, [top]))
    ]
    assert missing == []


def test_every_dependency_is_imported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[^\w.-]", entry)[0].lower().replace("_", "-") for entry in project["dependencies"]}
    tops = {found.module.split(".")[0] for path, source in sources("jbridge") for found in imports(path, source)}
    providers = packages_distributions()
    imported = {name.lower().replace("_", "-") for top in tops for name in providers.get(top, [top])}
    assert declared - imported == {"flatbuffers"}  # which jax.export asks for


@pytest.mark.parametrize(
    ("path", "source", "complaint"),
    [
        ("jbridge/model/bridge.py", "from jbridge.simulation.rollout import rollout", "imports up, from simulation"),
        ("jbridge/model/effects/base.py", "from ...control import base", "model imports up, from control"),
        ("jbridge/simulation/rollout.py", "from jbridge import sweep", "simulation imports up, from sweep"),
        ("jbridge/fuzzy/rules.py", "from ..model.bridge import Bridge", "fuzzy imports sideways, from model"),
        ("jbridge/tuning/search.py", "def f():\n    import jbridge.diagnosis.noise", "tuning imports sideways"),
        ("jbridge/report/save.py", "from jbridge import Fit", "report imports the public face"),
        ("jbridge/report/save.py", "import jbridge", "report imports the public face"),
        ("jbridge/cli/fit.py", "from jbridge.identification.fit import fit", "cli imports identification instead of"),
        ("jbridge/__init__.py", "from jbridge.cli import main", "the public face imports cli"),
        ("jbridge/sweep.py", "from jbridge.utils import clip", "imports utils, which has no layer"),
        ("jbridge/utils.py", "", "utils has no layer"),
    ],
)
def test_a_bad_import_is_found(path, source, complaint):
    (found,) = upward_imports(PurePath(path), source)
    assert complaint in found


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("jbridge/__init__.pyi", "from .report.save import save_report as save_report"),
        ("jbridge/model/plant.py", "from jbridge.model.bridge import Bridge\nfrom . import effects"),
        ("jbridge/simulation/rollout.py", "from jbridge import control\nfrom jbridge._types import Dof"),
        ("jbridge/identification/fit.py", "import jax\nfrom jbridge.simulation.rollout import rollout"),
        ("jbridge/cli/fit.py", "import jbridge\nfrom jbridge import __version__, simulate"),
        ("jbridge/__main__.py", "from jbridge.cli import main"),
    ],
)
def test_a_good_import_passes(path, source):
    assert upward_imports(PurePath(path), source) == []


def test_a_private_import_is_found():
    source = "from jbridge import simulate\nimport numpy\nfrom jbridge.simulate import Trajectory"
    (found,) = private_imports(PurePath("experiments/figure.py"), source)
    assert found == "experiments/figure.py:3: imports jbridge.simulate"


def test_packages_have_at_most_a_dozen_modules():
    large = {}
    for folder in {ROOT / path.parent for path, _ in sources("jbridge")}:
        modules = [path.name for path in folder.glob("*.py") if path.name != "__init__.py"]
        if len(modules) > 12:
            large[str(folder.relative_to(ROOT))] = len(modules)
    assert large == {}


def test_tests_mirror_the_package():
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")}
    mirrored = {folder for folder in folders if folder.parts[:1] != ("experiments",)}
    assert [str(folder) for folder in mirrored if not (ROOT / "jbridge" / folder).is_dir()] == []
