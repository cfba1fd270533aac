"""Puts a known truth into the recordings of real rigs, and looks whether a diagnosis names and sizes it.

    python experiments/real_rigs/planted.py                     # all, an hour
    python experiments/real_rigs/planted.py emps --jobs 2       # those of one rig
    python experiments/real_rigs/planted.py --figures           # the table from the kept numbers

Each alteration is exact, whatever else the rig lacks: an input that is recorded earlier than it acts, divided by an
asymmetry or short of a constant part, a sensor with an offset or another scale, time stamps that run fast. All
recordings of a rig are altered alike, the hold-out included. What `run.py` says of the unaltered ones stands beside it.
"""

import argparse
import json
import multiprocessing
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import jbridge
from experiments.real_rigs.run import KEPT, ROOT, SHARED, load, model_file, rigs

PLANTED = ROOT / "figures" / "data" / "real-rigs-planted.json"
TABLE = ROOT / "figures" / "real-rigs-planted.md"
Row = dict[str, Any]


class Truth(NamedTuple):
    """What is put into the recordings of a rig."""

    rig: str
    kind: str
    site: str
    key: str
    """Of the effect's number that is set."""
    size: float
    """What the number should change by, or, for a scale, be multiplied with."""
    unit: str

    @property
    def label(self) -> str:
        return f"{self.rig}: {self.kind}"


TRUTHS = (
    Truth("emps", "input_delay", "cart_drive", "delay", 0.03, "s"),
    Truth("emps", "gain_asymmetry", "cart_drive", "ratio", 0.05, "1"),
    Truth("emps", "constant_force", "cart", "level", 10.0, "N"),
    Truth("Aalborg cart", "input_delay", "cart_drive", "delay", 0.04, "s"),
    Truth("Aalborg cart", "constant_force", "cart", "level", 3.0, "N"),
    Truth("Aalborg pendulum 1", "sensor_offset", "psi_sensor", "offset", 0.03, "rad"),
    Truth("Aalborg pendulum 1", "clock_scale", "clock", "scale", 1.05, "1"),
    Truth("Aalborg pendulum 2", "sensor_offset", "psi_sensor", "offset", 0.03, "rad"),
    Truth("Aalborg pendulum 2", "clock_scale", "clock", "scale", 1.05, "1"),
    Truth("Washington pendulum", "sensor_offset", "psi_sensor", "offset", 0.03, "rad"),
    Truth("INTECO pendulum", "sensor_offset", "psi_sensor", "offset", 0.05, "rad"),
    Truth("student crane, 1", "input_delay", "cart_drive", "delay", 0.1, "s"),
    Truth("student crane, 1", "gain_asymmetry", "cart_drive", "ratio", 0.1, "1"),
    Truth("student crane, 1", "sensor_scale", "psi_sensor", "scale", 1.2, "1"),
    Truth("gantry, trolley", "input_delay", "cart_drive", "delay", 0.1, "s"),
    Truth("gantry, trolley", "sensor_scale", "psi_sensor", "scale", 1.2, "1"),
)


def _late(recording: jbridge.Recording, delay: float) -> jbridge.Recording:
    """Inputs recorded so much earlier than they act. Left out are the last rows, of which no input is known, and the
    first ones, which feel inputs from before them."""
    shift = round(delay / float(np.median(np.diff(recording.times))))
    assert recording.u_x is not None
    early = replace(recording.rows(slice(0, len(recording.times) - shift)), u_x=recording.u_x[shift:], earlier=None)
    return early.rows(slice(shift, None))


def _uneven(recording: jbridge.Recording, ratio: float) -> jbridge.Recording:
    assert recording.u_x is not None
    return replace(recording, u_x=recording.u_x / (1.0 + ratio * np.sign(recording.u_x)))


def _read(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[jbridge.Recording], jbridge.Recording]:
    def altered(recording: jbridge.Recording) -> jbridge.Recording:
        assert recording.psi is not None
        return replace(recording, psi=change(recording.psi))

    return altered


def altered(recording: jbridge.Recording, truth: Truth, gain: float) -> jbridge.Recording:
    """A recording as it would be if the rig had the effect as well; `gain` is the drive's in N per input unit."""
    size = truth.size
    if truth.kind == "input_delay":
        return _late(recording, size)
    if truth.kind == "gain_asymmetry":
        return _uneven(recording, size)
    if truth.kind == "constant_force":
        assert recording.u_x is not None
        return replace(recording, u_x=recording.u_x - size / gain)
    if truth.kind == "clock_scale":
        first = recording.times[0]
        return replace(recording, times=first + (recording.times - first) / size)
    if truth.kind == "sensor_offset":
        return _read(lambda psi: psi + size)(recording)
    assert truth.kind == "sensor_scale"
    return _read(lambda psi: psi * size)(recording)


def diagnosed(truth: Truth, budget: float, out: Path) -> Row:
    """What a diagnosis of the altered recordings says; its report lies below `out`."""
    rig = rigs()[truth.rig]
    jbridge.set_up(True)
    model = jbridge.load_model(model_file(rig))
    gain = float(model.plant.bridge.cart_gain)

    def loaded(role: str) -> list[jbridge.Recording]:
        return [altered(load(rig, piece), truth, gain) for piece in rig.get(role, ())]

    found = jbridge.diagnose(model, loaded("train"), loaded("holdout"), budget=budget)
    folder = out / truth.label.replace(" ", "-").replace(",", "").replace(":", "")
    jbridge.save_report(folder, found)
    report = json.loads((folder / "report.json").read_text())
    return {key: report[key] for key in ("verdict", "stopped", "seconds", "effects", "bridge")}


def _found(row: Row, truth: Truth) -> Row | None:
    """The planted effect as a diagnosis has it, by its own name or beside one that it cannot be told from."""
    for effect in row["effects"]:
        if (effect["kind"], effect["site"]) == (truth.kind, truth.site):
            return effect
    for effect in row["effects"]:
        for rival in effect["equivalents"]:
            if (rival["kind"], rival["site"]) == (truth.kind, truth.site):
                return rival | {"beside": effect}
    return None


def _size(found: Row | None, truth: Truth) -> float | None:
    value = found["parameters"].get(truth.key, {}).get("value") if found else None
    return value if isinstance(value, float) else None


def _words(found: Row | None, truth: Truth) -> str:
    if found is None:
        return "not named"
    beside = found.get("beside")
    size = _size(found, truth)
    said = f"{size:.3g} {truth.unit}".removesuffix(" 1") if size is not None else ""
    if beside is None:
        return f"{found['status']}, {said}"
    return f"not told from {beside['kind']} ({beside['status']}), {said}".replace("_", " ")


def table(rows: dict[str, Row]) -> str:
    """The page in markdown."""
    lines = [
        "# A known truth in real recordings",
        "",
        "Recordings of real rigs, altered exactly as one effect more would alter them, hold-out included; everything",
        "else that the rigs lack is still lacking. Beside each what the diagnosis of the unaltered recordings says.",
        "Redrawn by `python experiments/real_rigs/planted.py --figures`; do not edit.",
        "",
        "| rig | put in | unaltered | altered | change | first named | verdict | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for truth in TRUTHS:
        row = rows.get(truth.label)
        if row is None:
            continue
        before, after = _found({"effects": row["unaltered"]}, truth), _found(row, truth)
        sizes = [_size(before, truth), _size(after, truth)]
        absent = 1.0 if truth.key == "scale" else 0.0
        first, last = (absent if size is None else size for size in sizes)
        change = "" if sizes[1] is None else f"{last / first if absent else last - first:.3g} {truth.unit}"
        names = [f"{e['kind']} {e['site']}".replace("_", " ") for e in row["effects"]]
        lines.append(
            f"| {truth.rig} | {truth.kind.replace('_', ' ')} {truth.size:g} {truth.unit}".removesuffix(" 1")
            + f" | {_words(before, truth)} | {_words(after, truth)} | {change.removesuffix(' 1')}"
            f" | {names[0] if names else 'nothing'} | `{row['verdict']}` | {row['seconds']:.0f} |"
        )
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="rigs (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="diagnoses at a time (default: %(default)d)")
    parser.add_argument("--budget", type=float, default=300.0, help="seconds for each (default: %(default)g)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "real-rigs-planted", help="where reports go")
    parser.add_argument("--kept", type=Path, default=PLANTED, help="where numbers are kept")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - {truth.rig for truth in TRUTHS})
    if unknown:
        parser.error(f"nothing is put into {', '.join(unknown)}; rigs are {', '.join({p.rig: 0 for p in TRUTHS})}")
    kept = json.loads(arguments.kept.read_text()) if arguments.kept.is_file() else {}
    if not arguments.figures:
        if not SHARED.is_dir():
            print(f"skipped: the recordings are not at {SHARED}; JBRIDGE_RECORDINGS names another folder")
            return
        chosen = [truth for truth in TRUTHS if not arguments.names or truth.rig in arguments.names]
        alone = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(arguments.jobs, alone, max_tasks_per_child=1) as pool:
            waiting = {pool.submit(diagnosed, truth, arguments.budget, arguments.out): truth for truth in chosen}
            for done in as_completed(waiting):
                # What is said of the unaltered ones now: `run.py` may run again before the next row is made.
                unaltered = json.loads(KEPT.read_text())[waiting[done].rig]["effects"]
                kept[waiting[done].label] = done.result() | {"unaltered": unaltered}
                print(
                    f"{waiting[done].label}: {_words(_found(done.result(), waiting[done]), waiting[done])}", flush=True
                )
                arguments.kept.parent.mkdir(parents=True, exist_ok=True)
                arguments.kept.write_text(json.dumps(kept, indent=1) + "\n")
    if arguments.kept == PLANTED:
        TABLE.write_text(table(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
