"""Whatever disks and other processes do: one clear line or a silent recovery, whole files, and the same numbers."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from jbridge.compilation import settings
from jbridge.report.files import alone_in_folder

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))

import kills

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no limits, locks and users as on Unix")
EVERY = [*kills.COMMANDS, *kills.OTHERS]


def start(folder, name, out, *, within="", **environment):
    """A command in a process of its own, as `python -m jbridge` is, which is begun by one that first does something."""
    code = f"import os, sys\n{within}\nos.execv(sys.executable, sys.argv[1:])"
    return subprocess.Popen(
        [sys.executable, "-c", code, sys.executable, "-m", "jbridge", *kills.words_of(name, out)], cwd=folder,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=os.environ | environment,
    )  # fmt: skip


def ended(process):
    """Exit status of a command, and what it said of errors."""
    _, said = process.communicate()
    return process.returncode, said


def refused(process):
    """The one line with which a command ended."""
    status, said = ended(process)
    assert status == 2 and said.startswith("jbridge: ") and said.count("\n") == 1, said
    return said


@pytest.mark.slow
@pytest.mark.parametrize("size", [0, 10_000])
@pytest.mark.parametrize("name", EVERY)
def test_a_full_disk_is_told_and_leaves_whole_files(tmp_path, name, size):
    """The system takes no file beyond a size, in results and caches alike, as when a share of a disk is used up."""
    kills.prepare(tmp_path)
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))"
    process = start(tmp_path, name, "out", within=limit)
    if name in ("export", "simulate") and size:
        assert ended(process) == (0, "")  # their files are smaller
    else:
        assert "File too large" in refused(process)
    kills.contents(tmp_path, "out")  # reads all that is there
    assert not [path for path in tmp_path.rglob("*.part")]


def test_a_summary_that_cannot_be_written_is_told(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("no device that is always full")
    kills.prepare(tmp_path)
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "jbridge", *kills.words_of("export", "out")], cwd=tmp_path,
            stdout=full, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    told = "jbridge: No space left on device; make room, and call again; finished files are whole\n"
    assert (done.returncode, done.stderr) == (2, told)
    assert (tmp_path / "out" / "model.h").read_text().endswith("\n")


AS_ANYONE = "import ctypes; assert os.geteuid() or not ctypes.CDLL(None).prctl(24, 1)"
"""Takes from root's next program the right to write anywhere: PR_CAPBSET_DROP of CAP_DAC_OVERRIDE."""


@pytest.mark.parametrize("name", EVERY)
def test_a_folder_that_can_only_be_read_is_refused_at_once(tmp_path, name):
    """Before anything is computed; neither is there a home for the cache."""
    if os.geteuid() == 0 and sys.platform != "linux":
        pytest.skip("root may write anywhere")
    kills.prepare(tmp_path)
    tmp_path.chmod(0o555)
    try:
        process = start(tmp_path, name, "out", within=AS_ANYONE, HOME=str(tmp_path))
        assert ". cannot be written to; choose another --out" in refused(process)
    finally:
        tmp_path.chmod(0o755)
    assert not list(tmp_path.glob("out*"))


def test_two_results_do_not_mix_in_one_folder(tmp_path):
    """Whoever comes second waits until the first has written all of its files."""
    first_is_at_it, second_waits = threading.Event(), threading.Event()

    @alone_in_folder
    def save(folder, text):
        (folder / "one").write_text(text)
        if text == "first":
            first_is_at_it.set()
            second_waits.wait(10.0)
        (folder / "two").write_text(text)

    first = threading.Thread(target=save, args=(tmp_path / "out", "first"))
    second = threading.Thread(target=save, args=(tmp_path / "out", "second"))
    first.start()
    assert first_is_at_it.wait(10.0)
    second.start()
    second.join(0.3)
    assert second.is_alive() and (tmp_path / "out" / "one").read_text() == "first"
    second_waits.set()
    first.join(), second.join()
    assert [(tmp_path / "out" / name).read_text() for name in ("one", "two")] == ["second", "second"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fit", "sweep", "export"])
def test_two_commands_with_one_folder_end_as_one_of_them(tmp_path, name):
    kills.prepare(tmp_path)
    assert ended(start(tmp_path, name, "alone")) == (0, "")
    both = [start(tmp_path, name, "out") for _ in range(2)]
    assert [ended(process) for process in both] == [(0, "")] * 2
    assert kills.contents(tmp_path, "out") == kills.contents(tmp_path, "alone")


@pytest.mark.slow
def test_two_sweeps_with_one_folder_are_told_apart(tmp_path):
    kills.prepare(tmp_path)
    one = start(tmp_path, "sweep", "out")
    while not (tmp_path / "out.sweep.json").exists():
        assert one.poll() is None
        time.sleep(0.1)
    (tmp_path / "spec.toml").write_text(kills.SWEEP.replace("seed = 5", "seed = 6"))
    assert "out: holds the results of another sweep; choose another --out" in refused(start(tmp_path, "sweep", "out"))
    assert ended(one) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simulate", "fit"])
def test_a_torn_cache_costs_time_and_changes_nothing(tmp_path, name):
    kills.prepare(tmp_path)
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    assert ended(start(tmp_path, name, "first", **cache)) == (0, "")
    own = tmp_path / "cache" / "jbridge"  # matplotlib has another one
    kept = [path for path in own.rglob("*") if path.is_file() and not path.name.endswith("-atime")]
    kinds = {path.relative_to(own).parts[0] for path in kept}
    assert kinds == ({"jax", "programs"} if name == "fit" else {"jax"})
    for number, path in enumerate(sorted(kept)):
        whole = path.read_bytes()
        turned = bytearray(whole)
        turned[len(whole) // 2] ^= 16
        path.write_bytes((whole[: len(whole) // 2], b"", bytes(turned), bytes(len(whole)))[number % 4])
    assert ended(start(tmp_path, name, "again", **cache)) == (0, "")
    assert kills.contents(tmp_path, "again") == kills.contents(tmp_path, "first")


def test_other_processors_have_compiled_programs_of_their_own(tmp_path, monkeypatch):
    """A compiled program holds instructions that another processor need not have; a home folder may be shared."""
    names = []
    for flags in ("sse2 avx2", "sse2 avx2 avx512f", "sse2 avx2"):
        monkeypatch.setattr(settings, "_INSTRUCTIONS", tmp_path / "cpuinfo")
        (tmp_path / "cpuinfo").write_text(f"processor\t: 0\ncpu MHz\t\t: {len(names)}\nflags\t\t: {flags}\n")
        names.append(settings._processor())
    assert names[0] == names[2] != names[1]
    code = (
        "from jbridge.compilation import settings; import jax\n"
        "settings.set_up(); print(jax.config.jax_compilation_cache_dir, settings._processor())"
    )
    env = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True)
    folder, name = done.stdout.split()
    assert folder == str(tmp_path / "jbridge" / "jax" / name)
