"""What is built for others holds the whole package and nothing of this machine."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import jbridge

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    pytest.importorskip("hatchling", reason="needs hatchling, which requirements.lock has")
    folder = tmp_path_factory.mktemp("built")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", folder], cwd=ROOT, check=True, capture_output=True
    )
    return folder


def test_the_wheel_has_every_file_of_the_package(built):
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        inside = {name for name in archive.namelist() if name.startswith("jbridge/")}
    package = [path for path in (ROOT / "jbridge").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert inside == {path.relative_to(ROOT).as_posix() for path in package}


def test_the_wheel_runs_from_any_folder(built, tmp_path):
    """Unpacked as an installation unpacks it; the demo's recordings are read from it."""
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    demo = tmp_path / "site" / "jbridge" / "demo_data"
    for words, wanted in (
        (["--version"], jbridge.__version__),
        (["check", str(demo / "train-1.csv")], "NO PROBLEM FOUND"),
    ):
        start = f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r}); import jbridge.cli as c; "
        start += f"assert c.__file__.startswith({str(tmp_path)!r}); sys.exit(c.main({words!r}))"
        done = subprocess.run([sys.executable, "-c", start], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert wanted in done.stdout


def test_the_sources_hold_no_cache(built):
    (sources,) = built.glob("*.tar.gz")
    with tarfile.open(sources) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    assert {name.split("/")[0] for name in names if name.startswith(".")} <= {".ci", ".gitignore"}
    assert {"pyproject.toml", "LICENSE", "README.md", "jbridge/demo_data/train-1.csv", "docs/own-rig.md"} <= set(names)
    assert not [name for name in names if "__pycache__" in name]
