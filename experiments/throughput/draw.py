"""The measured numbers as two pictures and a table."""

import json
from pathlib import Path
from typing import Any

MODES = ("open", "closed")
STYLES = {"float64": "-", "float32": "--"}
ENGINES = {"jbridge": ("jbridge", "#0a6ebd"), "cpp": ("C++", "#dd6a00")}


def everything(saved: dict[str, Any], folder: Path) -> None:
    """Writes all that is drawn of the saved numbers to a folder."""
    against_batch(saved, folder / "throughput.png")
    if "horizon" in saved:
        against_horizon(saved, folder / "throughput-horizon.png")
    (folder / "throughput-table.md").write_text("\n".join(table(saved, folder)) + "\n")


def _panels(label: str) -> tuple[Any, Any]:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    plt.style.use("jbridge.report.figures.common")
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained", sharey=True)
    for panel, mode in zip(panels, MODES, strict=True):
        panel.set_title(f"{mode} loop")
        panel.set_xlabel(label)
    return figure, panels


def against_batch(saved: dict[str, Any], path: Path) -> None:
    figure, panels = _panels("bridges in a batch")
    for panel, mode in zip(panels, MODES, strict=True):
        for precision, style in STYLES.items():
            rows = [r for r in saved["rows"] if (r["mode"], r["precision"]) == (mode, precision)]
            for key, (name, colour) in ENGINES.items():
                lanes, rates = [r["lanes"] for r in rows], [r[key] for r in rows]
                panel.loglog(lanes, rates, style, color=colour, marker="o", ms=3, label=f"{name}, {precision}")
    panels[0].set_ylabel("steps of one bridge per second")
    panels[0].legend(fontsize=9)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def against_horizon(saved: dict[str, Any], path: Path) -> None:
    figure, panels = _panels("simulated time [s]")
    for panel, mode in zip(panels, MODES, strict=True):
        rows = [r for r in saved["horizon"] if r["mode"] == mode]
        for key, (name, colour) in ENGINES.items():
            # A step is 5 ms in both loops.
            cost = [200.0 * r["seconds"] * r["lanes"] / r[key] for r in rows]
            panel.loglog([r["seconds"] for r in rows], cost, color=colour, marker="o", ms=3, label=name)
        panel.set_title(f"{mode} loop, {rows[0]['lanes']} bridges")
    panels[0].set_ylabel("computing time [s]")
    panels[0].legend(fontsize=9)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def aims(saved: dict[str, Any], folder: Path | None = None) -> list[str]:
    """What was aimed at beside what was measured."""

    def best(mode: str) -> str:
        rows = [r for r in saved["rows"] if (r["mode"], r["precision"]) == (mode, "float64")]
        row = max(rows, key=lambda r: r["jbridge"])
        return f"{row['ratio']:.2f} ({row['jbridge'] / 1e6:.3g} against {row['cpp'] / 1e6:.3g} M steps/s)"

    def rival(name: str) -> str:
        row = next(r for r in saved["rivals"] if r["name"] == name)
        return "not installed" if row.get("missing") else f"{row['jbridge'] / row['rate']:.3g}"

    gradient, few, smooth, first = (saved[key] for key in ("gradient", "few", "smooth", "compile"))
    remade, kept = (f"{gradient[key] / gradient['forward']:.2f}" for key in ("rematerialised", "kept"))
    torch = next(r for r in saved["rivals"] if r["name"] == "torch-fis")
    to_torch = "not installed" if torch.get("missing") else f"{torch['gradient'] / torch['jbridge gradient']:.3g}"
    (short, low), (long, high) = ((name, saved["memory"][name]["peak"]) for name in saved["memory"])
    gradient_of = "value and gradient of a closed loop"
    rows = [
        ("forward, open loop, float64, best batch, against the C++", ">= 1.0", best("open")),
        ("forward, both fuzzy controllers, against the C++", ">= 1.1", best("closed")),
        ("time of smooth inference against hard", "<= 1.5", f"{smooth['smooth'] / smooth['hard']:.2f}"),
        (f"{gradient_of}, against its forward, rematerialised", "<= 4", remade),
        ("the same, every stage of a period kept (without `reverse=True`)", "<= 4", kept),
        ("forward against MuJoCo, 256 bare bridges", ">= 50", rival("mujoco")),
        ("forward against torch-fis, 256 bare bridges", ">= 10", rival("torch-fis")),
        ("gradient against torch-fis, the same", ">= 5", to_torch),
        (
            f"4 bare bridges x {few['seconds']:g} s against plain `diffeqsolve`",
            ">= 4",
            f"{few['plain'] / few['jbridge']:.2f} ({few['diffrax'] / few['jbridge']:.2f} with our compiler options)",
        ),
        ("compile: open loop, cold [s]", "<= 2", f"{first['open']:.1f}"),
        (f"compile: {gradient_of}, cold [s]", "<= 6", f"{gradient['compile rematerialised']:.1f}"),
        (f"peak memory of summaries, {float(long):g} s against {float(short):g} s", "<= 1.1", f"{high / low:.2f}"),
    ]
    timed = None if folder is None else folder / "data" / "diagnosis-time.json"
    if timed is not None and timed.exists():
        warm = json.loads(timed.read_text())
        rows.append(("diagnosis of 6 recordings of 16 s, warm [s]", "<= 60", f"{warm['warm_s']:.0f}"))
    return ["| measure | aim | measured |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows)]


def table(saved: dict[str, Any], folder: Path) -> list[str]:
    """The page of all numbers."""
    lines = [
        "# Throughput", "",
        f"Steps of one bridge per second over the whole batch (RK4), {saved['cores']} cores, {saved['processor']}.",
        "C++: the same by hand (`experiments/throughput/reference.cpp`). Redrawn by",
        "`python experiments/throughput/throughput.py --figures`; do not edit.", "",
    ]  # fmt: skip
    if "gradient" in saved:
        lines += [*aims(saved, folder), ""]
    lines += [
        "| loop | precision | bridges | jbridge [M/s] | C++ [M/s] | ratio | first call [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in saved["rows"]:
        rates = f"{r['jbridge'] / 1e6:.3g} | {r['cpp'] / 1e6:.3g} | {r['ratio']:.2f}"
        lines.append(f"| {r['mode']} | {r['precision']} | {r['lanes']} | {rates} | {r['first_call']:.1f} |")
    if "rivals" in saved:
        lines += [
            "",
            "Bridges without friction and drives, float64; final positions agree to the difference [m, rad].",
            "",
            "| engine | bridges | simulated [s] | jbridge [M/s] | engine [M/s] | ratio | difference |",
            "|---|---|---|---|---|---|---|",
        ]
        for r in saved["rivals"]:
            if r.get("missing"):
                lines.append(f"| {r['name']} | {r['lanes']} | | | not installed | | |")
                continue
            rates = f"{r['jbridge'] / 1e6:.3g} | {r['rate'] / 1e6:.3g} | {r['jbridge'] / r['rate']:.3g}"
            lines.append(f"| {r['name']} | {r['lanes']} | {r['seconds']:g} | {rates} | {r['difference']:.1g} |")
    return lines
