"""Table and picture of the real rigs, from kept numbers alone."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

plt.style.use("jbridge.report.figures.common")

Row = dict[str, Any]
SHOWN = 1.0
"""Horizon of the table's errors [s]."""
NAMES = {"x": "x", "psi": "angle", "l": "length"}


def draw(kept: dict[str, Row], rigs: dict[str, Row], folder: Path) -> None:
    """Writes `real-rigs-table.md` and `real-rigs.png`."""
    rows = {name: kept[name] for name in rigs if name in kept}
    (folder / "real-rigs-table.md").write_text(table(rows, rigs), encoding="utf-8")
    figure = picture(rows)
    figure.savefig(folder / "real-rigs.png", dpi=110)
    plt.close(figure)


def table(rows: dict[str, Row], rigs: dict[str, Row]) -> str:
    """The page in markdown."""
    lines = [
        "# Real rigs",
        "",
        "Measured data of others, read in place; none of it is copied here. Diagnoses start from damping alone. Errors",
        "are of the hold-out, typical ones (geometric mean over windows of 1 s in motion) as multiples of the noise,",
        "before (the model as given, refitted) and after. A share in brackets is of the excess squared error that the",
        "effect alone closes.",
        "Redrawn by `python experiments/real_rigs/run.py --figures`; do not edit.",
        "",
        "| rig | what is known | verdict, share explained | what is named | error at 1 s | s | GB | version |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        said = [f"`{row['verdict']}`" + (", complete" if row["complete"] else "")]
        shares = {axis: share for axis, share in row["explained"].items() if axis != "all" and share is not None}
        said += [f"{NAMES[axis]} {percent(share)}" for axis, share in shares.items() if row["effects"]]
        said += [] if row["stopped"] == "criterion" else [f"stopped by the {row['stopped']}"]
        lines.append(
            f"| {name} | {rigs[name]['known']} | {', '.join(said)} | {named(row)} | {errors(row)} |"
            f" {row['seconds']} | {row['gigabytes']:.1f} | {row['code'][:7]} |"
        )
    lines += ["", "![Error over prediction horizon](real-rigs.png)", "", "Sources:", ""]
    sources = dict.fromkeys(rig["source"] for rig in rigs.values() if "source" in rig)
    return "\n".join([*lines, *(f"- {source}" for source in sources), ""])


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def named(row: Row) -> str:
    """Effects with status, share and numbers, and the rig's own numbers."""
    said = []
    for effect in row["effects"]:
        about = [effect["status"]] + ([] if effect["explained"] is None else [percent(effect["explained"])])
        rivals = [f"{r['kind']} {r['site']}" for r in effect["equivalents"]]
        about += [f"or {', '.join(rivals)}"] if rivals else []
        numbers = [
            f"{key} {told['value']:.3g} {told['unit']}".removesuffix(" 1").rstrip()
            for key, told in effect["parameters"].items()
            if isinstance(told["value"], float) and told["std"]
        ]
        maps = [key for key, told in effect["parameters"].items() if isinstance(told["value"], list)]
        numbers += [f"a map of {', '.join(maps)}"] if maps else []
        said.append(f"{effect['kind']} {effect['site']} ({'; '.join(about)}): {', '.join(numbers)}")
    own = [f"{key} {told['value']:.4g} {told['unit']}" for key, told in row["bridge"].items() if told["std"]]
    return ("; ".join([*said, ", ".join(own)]) if said else f"nothing; {', '.join(own)}").replace("_", " ")


def errors(row: Row) -> str:
    nearest = min(row["fit"]["horizons"], key=lambda h: abs(h["seconds"] - SHOWN), default=None)
    if nearest is None:
        return ""
    noise, typical = row["fit"]["noise"], nearest["typical"]
    return "; ".join(
        f"{NAMES[axis]} {typical['before'][axis] / noise[axis]:.3g} to {typical['after'][axis] / noise[axis]:.3g}"
        for axis in typical["before"]
    )


def picture(rows: dict[str, Row]) -> plt.Figure:
    """Error over prediction horizon of every rig, a column for each and a line for each channel."""
    across = 4
    down = -(-len(rows) // across)
    figure, places = plt.subplots(down, across, figsize=(3.1 * across, 2.5 * down), squeeze=False, layout="constrained")
    colours = {"x": "#0a6ebd", "psi": "#dd6a00", "l": "#00805c"}
    for place in places.flat[len(rows) :]:
        place.axis("off")
    for place, (name, row) in zip(places.flat, rows.items(), strict=False):
        horizons = row["fit"]["horizons"]
        seconds = [h["seconds"] for h in horizons]
        for axis, noise in row["fit"]["noise"].items():
            for when, style in (("before", "--"), ("after", "-")):
                values = [h["typical"][when].get(axis, float("nan")) / noise for h in horizons]
                place.loglog(seconds, values, style, color=colours[axis], marker="o", ms=3)
        place.axhline(1.0, color="grey", lw=0.8)
        place.set_title(name, fontsize=9)
        place.set_xticks(seconds, [f"{s:g}" for s in seconds])
        place.minorticks_off()
        place.tick_params(labelsize=7)
    keys = [plt.Line2D([], [], color=colour, label=NAMES[axis]) for axis, colour in colours.items()]
    keys += [
        plt.Line2D([], [], color="black", ls=style, label=when) for when, style in (("before", "--"), ("after", "-"))
    ]
    figure.legend(handles=keys, loc="outside upper center", ncols=len(keys), fontsize=8)
    figure.supxlabel("prediction horizon [s]", fontsize=9)
    figure.supylabel("typical error over noise, hold-out", fontsize=9)
    return figure
