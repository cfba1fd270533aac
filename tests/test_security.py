"""Files are data: nothing in them is executed, and they name nothing outside their own folder."""

import ast
import pickle
import struct
from pathlib import Path

import pytest

import jbridge

PACKAGE = Path(__file__).parents[1] / "jbridge"
MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml", "subprocess", "runpy", "code"}
"""Modules that run what they read, or other programs."""
CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "execv", "allow_pickle", "read_pickle"}


def suspicious(source: str) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name.split(".")[0] in MODULES]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in MODULES:
            found.append(str(node.module))
        elif isinstance(node, ast.Call):
            name = node.func
            if isinstance(name, ast.Name) and name.id in CALLS:
                found.append(name.id)
            elif isinstance(name, ast.Attribute) and name.attr in CALLS - {"compile"}:  # that of `re` and of JAX
                found.append(name.attr)
            found += [str(word.arg) for word in node.keywords if word.arg in CALLS]
    return found


def test_nothing_runs_what_it_reads():
    sources = {path.name: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    # The exported unit is compiled: C from the package's own templates, into which a model brings numbers alone.
    assert {name: found for name, source in sources.items() if (found := suspicious(source))} == {
        "fmu.py": ["subprocess"]
    }


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from yaml import load",
        "x = eval(text)",
        "import os; os.system(text)",
        "import numpy as np; np.load(path, allow_pickle=True)",
    ],
)
def test_what_runs_would_be_found(source):
    assert suspicious(source)


class Bomb:
    """Writes a file where it is unpickled."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


READERS = {
    "a.csv": jbridge.load_recording,
    "a.mat": jbridge.load_recording,
    "model.toml": jbridge.load_model,
    "c.toml": jbridge.load_controller,
    "s.toml": jbridge.load_sweep,
    "r.toml": lambda path: jbridge.load_reference(path, 0.02),
    "a.fis": jbridge.load_fis,
    "report.json": lambda path: jbridge.load_former(path.parent),
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("protocol", [0, 5])
def test_a_pickle_is_not_opened(tmp_path, name, protocol):
    mark = tmp_path / "executed"
    content = pickle.dumps(Bomb(mark), protocol)
    pickle.loads(content)
    assert mark.exists()  # it would
    mark.unlink()
    (tmp_path / name).write_bytes(content)
    with pytest.raises(jbridge.InputError):
        READERS[name](tmp_path / name)
    assert not mark.exists()


def test_a_function_handle_is_refused(tmp_path):
    """MATLAB saves an anonymous function as an array of class 16 around what it needs."""

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + bytes(-len(content) % 8)

    def array(kind: int, name: bytes, *rest: bytes) -> bytes:
        shape = element(5, struct.pack("<ii", 1, 1))
        return element(14, element(6, struct.pack("<II", kind, 0)) + shape + element(1, name) + b"".join(rest))

    header = b"MATLAB 5.0 MAT-file, written for a test".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    inner = array(6, b"", element(9, struct.pack("<d", 1.0)))
    (tmp_path / "f.mat").write_bytes(header + array(16, b"f", inner))
    with pytest.raises(jbridge.InputError, match=r"f\.mat: f is a MATLAB object \(function or old-style object\)"):
        jbridge.load_recording(tmp_path / "f.mat")


@pytest.mark.parametrize(
    "name",
    [
        "../cart.fis",
        "/cart.fis",
        "a/../../cart.fis",
        "..",
        ".",
        "",
        "C:cart.fis",
        "\\\\cart.fis",
        "a\\u0000b",
        "\\u001b[2J",
    ],
)
def test_a_controller_names_files_in_its_own_folder(tmp_path, name):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "cart.fis").write_text("secret")
    (inside / "c.toml").write_text(f'kind = "fuzzy"\ncart = "{name}"\n')
    with pytest.raises(jbridge.InputError, match=r"c\.toml: cart = .* does not lie beside this file or in a folder"):
        jbridge.load_controller(inside / "c.toml")


def test_a_controller_may_name_files_in_folders_below(tmp_path):
    (tmp_path / "rules").mkdir()
    law = jbridge.paper_controller()
    for axis in ("cart", "hoist"):
        jbridge.save_fis(tmp_path / "rules" / f"{axis}.fis", getattr(law, axis))
    (tmp_path / "c.toml").write_text(
        'kind = "fuzzy"\ncart = "rules/cart.fis"\nhoist = "rules/hoist.fis"\nangle_unit = "deg"\n'
    )
    assert jbridge.load_controller(tmp_path / "c.toml").law.cart.inputs[0].name == "error"
