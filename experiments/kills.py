"""What lies on disk after a command was killed at any moment? SIGKILL at random times, then the same command again.

    python experiments/kills.py              200 kills over fit, diagnose, tune and sweep: hours
    python experiments/kills.py --kills 10   two of each

Every file that a killed command leaves must be whole: it is read back. The command is then called again over what was
left, and must end with the files of one that nobody disturbed, byte for byte but for the seconds that it took.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from PIL import Image

ROOT = Path(__file__).parents[1]
MODEL = """
[bridge]
cart_mass = 2.0
load_mass = 0.15
cart_damping = 10.0
cart_gain = 5.0
swing_damping = 0.002
winch_mass = 0.1
hoist_damping = 25.0
hoist_gain = 3.0
known = ["cart_mass", "load_mass", "winch_mass"]
"""
SWEEP = """
model = "model.toml"
chunk = 64
[reference]
start = [0.0, 0.4]
goal = [0.3, 0.5]
rest = 2.0
[sample]
kind = "latin"
count = 512
seed = 5
[[vary]]
name = "cart_damping"
low = 5.0
high = 20.0
"""
COMMANDS = {
    "fit": ["fit", "cart.toml", "a.csv", "b.csv", "--out", "OUT"],
    "diagnose": ["diagnose", "cart.toml", "a.csv", "b.csv", "--holdout", "c.csv", "--out", "OUT"],
    "tune": [
        "tune",
        "model.toml",
        "--plants",
        "2",
        "--steps",
        "2",
        "--starts",
        "1",
        "--rail",
        "0",
        "0.8",
        "--out",
        "OUT",
    ],
    "sweep": ["sweep", "spec.toml", "--workers", "0", "--out", "OUT"],
}
OTHERS = {
    "check": ["check", "cart.toml", "a.csv", "b.csv", "--out", "OUT"],
    "simulate": ["simulate", "model.toml", "--input", "bridge.csv", "--out", "OUT/simulated.csv"],
    "control": ["control", "model.toml", "--out", "OUT"],
    "export": ["export", "model.toml", "--to", "c", "--out", "OUT"],
}
"""Commands that are over too soon to be worth a kill."""
TIMES = ("seconds",)
"""Keys of what a command says of its own time."""


def prepare(folder: Path) -> None:
    """A cart with a constant force that its model lacks, recorded three times, and a bridge with inputs of its own."""
    (folder / "model.toml").write_text(MODEL)
    (folder / "spec.toml").write_text(SWEEP)
    (folder / "cart.toml").write_text(
        "[bridge]\ncart_mass = 2.0\ncart_damping = 12.0\ncart_gain = 4.0\nknown = ['cart_mass']\n"
    )
    times = 0.02 * np.arange(100)
    inputs = np.stack([times, np.sign(np.sin(5 * times)), np.sign(np.sin(3 * times))], axis=1)
    np.savetxt(folder / "bridge.csv", inputs, "%.3f", ",", header="t,u_x,u_l", comments="")
    (folder / "bridge.toml").write_text("[initial]\nx = 0.3\npsi = 0.0\nl = 0.5\n")
    period, fade = 0.01, np.exp(-10.0 / 2.0 * 0.01)
    for seed, name in enumerate("abc"):
        key = np.random.default_rng(seed)
        volts = np.repeat(key.uniform(-2, 2, 10), 40)
        x, v, rows = 0.5, 0.0, []
        for k, volt in enumerate(volts):
            rows.append((k * period, volt, x + 1e-5 * key.standard_normal()))
            steady = (5.0 * volt + 1.5) / 10.0
            x, v = x + steady * period + (v - steady) * (1 - fade) * 0.2, steady + (v - steady) * fade
        np.savetxt(folder / f"{name}.csv", rows, "%.8f", ",", header="t,u_x,x", comments="")


def words_of(name: str, out: str) -> list[str]:
    """The command line of a command that writes into a folder."""
    return [word.replace("OUT", out) for word in (COMMANDS | OTHERS)[name]]


def run(folder: Path, name: str, out: str, until: float | None = None) -> float:
    """Seconds that a command took, or after which it was killed.

    Raises:
        RuntimeError: it failed, and was not killed.
    """
    words = words_of(name, out)
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "jbridge", *words], cwd=folder, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        _, said = process.communicate(timeout=until)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return time.monotonic() - begun
    if process.returncode:
        raise RuntimeError(f"{name}: status {process.returncode}: {said.decode()[-300:]}")
    return time.monotonic() - begun


def content(path: Path) -> object:
    """What a file holds, but for times; whoever is not whole cannot be read."""
    if path.suffix == ".json":
        return _without_times(json.loads(path.read_text()))
    if path.suffix == ".toml":
        return tomllib.loads(path.read_text())
    if path.suffix == ".parquet":
        return repr(pq.read_table(path).to_pydict())  # in which nan is nan
    if path.suffix == ".png":
        with Image.open(path) as image:
            return np.asarray(image).tobytes()
    text = path.read_text()
    if not text.endswith("</html>\n" if path.suffix == ".html" else "\n"):
        raise ValueError("does not end as it should")
    return None if path.suffix == ".html" else text  # a page says how long it took


def _without_times(found: object) -> object:
    if isinstance(found, dict):
        return {key: _without_times(value) for key, value in found.items() if key not in TIMES}
    return [_without_times(value) for value in found] if isinstance(found, list) else found


def contents(folder: Path, out: str) -> dict[str, object]:
    """All files of a command by name, read.

    Raises:
        ValueError: one is not whole.
    """
    found = {}
    for path in sorted(folder.glob(f"{out}*/**/*")) + sorted(folder.glob(f"{out}.*")):
        if path.is_file() and not path.name.endswith(".part"):
            try:
                found[path.relative_to(folder).as_posix().removeprefix(out)] = content(path)
            except Exception as error:
                raise ValueError(f"{path.name}: {error}") from error
    return found


def remove(folder: Path, out: str) -> None:
    shutil.rmtree(folder / out, ignore_errors=True)
    for path in folder.glob(f"{out}.*"):
        path.unlink()


def killed(folder: Path, name: str, kills: int, chance: random.Random) -> list[str]:
    """What was wrong after kills of one command."""
    run(folder, name, "first")  # compiles
    whole_time, wrong = run(folder, name, "whole"), []
    whole = contents(folder, "whole")
    if contents(folder, "first") != whole:
        wrong.append(f"{name}: two runs differ")
    for number in range(kills):
        after = run(folder, name, "out", chance.uniform(0.0, whole_time))
        try:
            left = contents(folder, "out")
            run(folder, name, "out")
            again = contents(folder, "out")
            differ = sorted(key for key in whole.keys() | again.keys() if whole.get(key) != again.get(key))
            if differ:
                wrong.append(f"{name}, killed after {after:.2f} s: the repeated command differs in {', '.join(differ)}")
            print(f"{name} {number + 1}: killed after {after:.2f} s, {len(left)} files of {len(whole)}", flush=True)
        except (ValueError, RuntimeError) as error:
            wrong.append(f"{name}, killed after {after:.2f} s: {error}")
        remove(folder, "out")
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200, help="over all commands (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    wrong, chance = [], random.Random(chosen.seed)
    for name in COMMANDS:
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            wrong += killed(Path(folder), name, chosen.kills // len(COMMANDS), chance)
    print("\n".join(wrong) or f"{chosen.kills} kills, nothing torn, and repeated commands end the same")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
