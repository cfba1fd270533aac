"""The concealed proof's table, from saved rows alone."""

from statistics import median


def wilson(hits: int, n: int) -> tuple[float, float]:
    """The 95 % Wilson interval of a share."""
    z = 1.96
    centre = (hits / n + z * z / (2 * n)) / (1 + z * z / n)
    half = z * ((hits / n * (1 - hits / n) + z * z / (4 * n)) / n) ** 0.5 / (1 + z * z / n)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def share(rows: list[dict], key: str) -> str:
    """`hits/all` and the percentage, with the 95 % Wilson interval: these are small numbers."""
    n, hits = len(rows), sum(bool(row[key]) for row in rows)
    if n == 0:
        return "none"
    low, high = wilson(hits, n)
    return f"{100 * hits / n:.0f} % ({hits}/{n}; {100 * low:.0f}-{100 * high:.0f})"


def groups(rows: list[dict]) -> dict[str, list[dict]]:
    """The rows by what is asked of them."""
    catalogued = [r for r in rows if r["true_verdict"] == "missing_physics"]
    marked = [r | {"said": r["verdict"] == "unknown"} for r in rows]
    return {
        "null": [r for r in rows if r["true_verdict"] == "adequate"],
        "visible": [r for r in rows if r["true"] and (r["before"] or 0.0) >= 5.0],
        "nameable": [r for r in catalogued if (r["before"] or 0.0) >= 5.0],
        "concealed": [r for r in rows if r["true"]],
        "single": [r for r in catalogued if len(r["true"]) == 1],
        "double": [r for r in catalogued if len(r["true"]) == 2],
        "triple": [r for r in catalogued if len(r["true"]) == 3],
        "catalogued": catalogued,
        "unknown": [r for r in marked if r["true_verdict"] == "unknown"],
        "known": [r for r in marked if r["true_verdict"] != "unknown"],
    }


def _placed(rows: list[dict], measure: str) -> tuple[list[dict], str]:
    """Local effects that were missing alone and not overlooked, and the key of whether each was located."""
    seen = [r for r in rows if len(r["true"]) == 1 and r["detected"]]
    found = [p[measure] for r in seen for p in r.get("placed", {}).values() if measure in p]
    if measure == "overlap":
        return [{"hit": overlap >= 0.5} for overlap in found], "hit"
    return [{"hit": late is not None and late <= 0.1} for late in found], "hit"


def _numbers(rows: list[dict], what: str) -> tuple[list[float], list[bool]]:
    found = [p for r in rows for p in r[what].values()]
    return [p["error"] for p in found], [p["covered"] for p in found if p["covered"] is not None]


def _percent(values: list, middle: bool = True) -> str:
    if not values:
        return "none"
    return f"{100 * (median(values) if middle else sum(values) / len(values)):.1f} % of {len(values)}"


def summary(rows: list[dict]) -> list[tuple[str, str, str]]:
    """Rows of the table: measure, aim, result."""
    g = groups(rows)
    errors, covered = _numbers(rows, "parameters")
    rig_errors, rig_covered = _numbers(rows, "bridge")
    gaps = [r["gap_closed"] for r in g["catalogued"] if r["gap_closed"] is not None]
    seconds = [r["wall"] for r in rows if r.get("wall") is not None]
    return [
        ("false alarms where only numbers are wrong", "<= 2 %", share(g["null"], "detected")),
        (
            "detected where the base model's hold-out error is >= 5 noise",
            ">= 98 %",
            share(g["visible"], "detected"),
        ),
        ("right equation, there", ">= 97 %", share(g["visible"], "equation_right")),
        ("exact set, there, where it has a name", "", share(g["nameable"], "set_right")),
        ("right equation, of all sizes", ">= 97 %", share(g["concealed"], "equation_right")),
        (
            "right effect, or its declared equivalent, named first, one missing",
            ">= 95 %",
            share(g["single"], "first_right"),
        ),
        ("right effect first or among its declared equivalents", "", share(g["single"], "in_set")),
        ("exact set, one missing", "", share(g["single"], "set_right")),
        ("exact set, two missing", ">= 80 %", share(g["double"], "set_right")),
        ("exact set, three missing", ">= 60 %", share(g["triple"], "set_right")),
        ("`unknown` said when it is", ">= 90 %", share(g["unknown"], "said")),
        ("`unknown` wrongly said", "<= 5 %", share(g["known"], "said")),
        (
            "local effects: region or time found overlaps by half, where one is missing and seen",
            "all",
            share(*_placed(rows, "overlap")),
        ),
        ("jumps: timed within 0.1 s, where one is missing and seen", "all", share(*_placed(rows, "late"))),
        ("verdict right", "", share(rows, "verdict_right")),
        ("effect parameters, median error", "<= 5 %", _percent(errors)),
        ("effect parameters, 95 % intervals that cover", "92-98 %", _percent(covered, middle=False)),
        ("the rig's own numbers, median error", "<= 5 %", _percent(rig_errors)),
        ("the rig's own numbers, 95 % intervals that cover", "92-98 %", _percent(rig_covered, middle=False)),
        ("hold-out gap closed, median", ">= 95 %", _percent(gaps)),
        ("models with one effect more that ended worse than without it", "0", _nested(rows, "worse")),
        ("the same, before they were fitted again from there", "<= 1 %", _nested(rows, "restarted")),
        (
            "seconds per case, median (longest)",
            "<= 60 s",
            f"{median(seconds):.0f} ({max(seconds):.0f})" if seconds else "none",
        ),
    ]


def _nested(rows: list[dict], key: str) -> str:
    """Share of all models with one effect more; of rows that count them."""
    counted = [r for r in rows if r.get("larger")]
    total, some = sum(r["larger"] for r in counted), sum(r[key] for r in counted)
    return f"{100 * some / total:.1f} % ({some}/{total})" if counted else "none"


def misses(rows: list[dict]) -> list[str]:
    """One line for every case with a wrong verdict, a wrong first effect or a wrong equation."""
    lines = []
    for r in rows:
        wrong = [] if r["verdict_right"] else [f"said {r['verdict']}, was {r['true_verdict']}"]
        if r["true"] and not r["equation_right"]:
            wrong.append(f"equation {r['equation']}, was {' or '.join(r['true_equations'])}")
        if r["true_verdict"] == "missing_physics" and not r["set_right"]:
            wrong.append(f"named {', '.join(r['named']) or 'nothing'}")
        if wrong:
            true = " + ".join(r["true"]) or "nothing missing"
            lines.append(f"- `{r['id']}` ({r['flavour']}, {r['loop']} loop) {true}: {'; '.join(wrong)}")
    return lines


FRESH = "; `fresh` came last, each case once"
PRESENT = "present"
"""Name of the rows of today's version, of any part."""
LISTED = {PRESENT: "cases", "dev": "dev", "blind": "blind", "blind2": "blind2", "blind3": "blind3"}
"""What is listed case by case, and the name of its list."""
AGAIN = "fresh-again"
"""Cases of `fresh` by a later version, which knows what the first one missed: no proof of anything."""
RUN_AGAIN = f", and was run whole again when its misses were known (`{AGAIN}`)"


def table(
    halves: dict[str, dict],
    rivals: dict[str, dict[str, list[dict]]] | None = None,
) -> str:
    """The whole page in markdown.

    Args:
        halves: by half, what the proof saved.
        rivals: by half and rival, rows of the same cases.
    """
    names = list(halves)
    columns = [summary(halves[n]["rows"]) for n in names]
    lines = [
        "# Concealed cases",
        "",
        "Recordings from another engine with true stick-slip; truths sealed before the diagnosis. Settings were",
        "chosen on `dev`; `proof` was opened once; `wide` has every effect at three sizes, and many versions ran",
        f"it{FRESH if 'fresh' in halves else ''}{RUN_AGAIN if AGAIN in halves else ''}.",
        "Percentages come with counts and 95 % Wilson intervals.",
        "A quarter of the nulls has friction that wanders. Redrawn by `run.py --figures`; do not edit.",
        "",
        "| measure | aim | " + " | ".join(names) + " |",
        "|" + "---|" * (2 + len(names)),
    ]
    for i, (measure, aim, _) in enumerate(columns[0]):
        lines.append(f"| {measure} | {aim} | " + " | ".join(column[i][2] for column in columns) + " |")
    for n in names:
        rows, made = halves[n]["rows"], halves[n]
        missed = misses(rows)
        lines += ["", f"## Misses of {n}: {len(missed)} of {len(rows)} cases", ""]
        codes = sorted({r["code"] for r in rows if r.get("code")}) or [made["commit"] or "unversioned"]
        code = ", ".join(codes)
        lines += [f"{len(rows)} of {made['cases']} cases run; code {code}; {made['cores']} cores.", ""]
        lines += missed or ["none"]
        if any(r.get("probability") is not None for r in rows):
            lines += ["", f"## By size, {n}", "", *by_severity(rows), "", *reliability(rows)]
    both = {n: rivals[n] for n in names if n in rivals} if rivals else {}
    if both:
        lines += beside(halves, both)
    return "\n".join(lines) + "\n"


SEVERITIES = ((0.0, 2.0), (2.0, 5.0), (5.0, 20.0), (20.0, float("inf")))
"""Of the hold-out error of the refitted model without the effect, over the noise, root mean square of the channels."""


PROBABILITIES = ((0.0, 0.6), (0.6, 0.9), (0.9, 0.99), (0.99, 1.01))
"""Bins of the probability of the first name."""


def by_severity(rows: list[dict]) -> list[str]:
    """How often what is missing is seen and named, over how large it is."""
    lines = ["| hold-out error over noise | cases | detected | right equation | exact set, where it has a name |"]
    lines += ["|---|---|---|---|---|"]
    for low, high in SEVERITIES:
        here = [r for r in rows if r["true"] and r["before"] is not None and low <= r["before"] < high]
        named = [r for r in here if r["true_verdict"] == "missing_physics"]
        span = f"{low:g} to {high:g}" if high < float("inf") else f"above {low:g}"
        shares = share(here, "detected"), share(here, "equation_right"), share(named, "set_right")
        lines.append(f"| {span} | {len(here)} | " + " | ".join(shares) + " |")
    failed = [r for r in rows if r["true"] and r["before"] is None]
    return [*lines, f"| did not finish | {len(failed)} | | | |"] if failed else lines


def with_probability(rows: list[dict]) -> list[dict]:
    """Rows with a verdict that names an effect, and how probable it was said to be."""
    return [r for r in rows if r.get("probability") is not None and r["verdict"] == "missing_physics"]


def reliability(rows: list[dict]) -> list[str]:
    """How often the first name is right where one was given as the verdict, over its probability."""
    lines = ["| probability of the first name | cases | mean probability | right |", "|---|---|---|---|"]
    told = with_probability(rows)
    for low, high in PROBABILITIES:
        here = [r for r in told if low <= r["probability"] < high]
        mean = f"{100 * sum(r['probability'] for r in here) / len(here):.1f} %" if here else "none"
        lines.append(f"| {low:g} to {min(high, 1.0):g} | {len(here)} | {mean} | {share(here, 'first_right')} |")
    return lines


NAMES = {"jbridge": "jbridge", "sindy": "SINDy", "greedy": "greedy BIC"}


def beside(halves: dict[str, dict], rivals: dict[str, dict[str, list[dict]]]) -> list[str]:
    """The section on rivals: the same measures over exactly the cases that all have."""
    lines = [
        "",
        "## Rivals on the same recordings",
        "",
        "What a careful practitioner gets from regression on force balances (`rivals.py`): SINDy (pysindy, STLSQ,",
        "its threshold by BIC) and grouped forward selection by BIC on weak-form residual forces. Both refit the",
        "model's own coefficients beside a library of catalogued laws; neither says `unknown`, simulates, or reads a",
        "hold-out. Their settings were chosen on `dev`. Backlash, belts, elastic ropes, double pendulums and missed",
        "counts have no column. Whether an error is >= 5 noise is taken from jbridge's rows.",
    ]
    for half, found in rivals.items():
        ours = {r["id"]: r for r in halves[half]["rows"]}
        common = set(ours).intersection(*({r["id"] for r in rows} for rows in found.values()))
        columns = {"jbridge": [ours[n] for n in sorted(common)]}
        for rival, rows in found.items():
            columns[rival] = [r | {"before": ours[r["id"]]["before"]} for r in rows if r["id"] in common]
        measured = [comparison(rows) for rows in columns.values()]
        lines += ["", f"{half}, {len(common)} cases", ""]
        lines += ["| measure | " + " | ".join(NAMES.get(n, n) for n in columns) + " |"]
        lines += ["|" + "---|" * (1 + len(columns))]
        for i, (measure, _) in enumerate(measured[0]):
            lines.append(f"| {measure} | " + " | ".join(column[i][1] for column in measured) + " |")
    return lines


def comparison(rows: list[dict]) -> list[tuple[str, str]]:
    """Measures that need no simulation, so that rivals have them too."""
    g = groups(rows)
    seconds = [r["wall"] for r in rows if r.get("wall") is not None]
    return [
        ("false alarms where only numbers are wrong", share(g["null"], "detected")),
        ("detected", share(g["concealed"], "detected")),
        ("detected where the base model's hold-out error is >= 5 noise", share(g["visible"], "detected")),
        ("right equation", share(g["concealed"], "equation_right")),
        ("right effect, or its declared equivalent, named first, one missing", share(g["single"], "first_right")),
        ("exact set, one missing", share(g["single"], "set_right")),
        ("exact set, two or three missing", share(g["double"] + g["triple"], "set_right")),
        ("`unknown` said when it is", share(g["unknown"], "said")),
        ("seconds per case, median (longest)", f"{median(seconds):.3g} ({max(seconds):.3g})" if seconds else "none"),
    ]


def parts(listed: dict[str, list[dict]]) -> str:
    """One row for each part: how often the first name, the set and the verdict are right.

    Args:
        listed: rows by the name of their list; a list of several parts has a row for each.
    """
    lines = [
        "# Concealed cases, by part",
        "",
        "Shares come with counts and 95 % Wilson intervals. An equivalent that was declared counts as right, such as a",
        "constant force and Coulomb friction in the place of friction by direction; a false alarm is an effect that is",
        "named, or an `unknown`, where nothing is hidden.",
        "Redrawn by `python experiments/concealed/run.py --figures`; do not edit.",
        "",
        "| part | cases | right name first | exact set | right verdict | confirmed names right | false alarms "
        "| s, median (longest) | version |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, rows in listed.items():
        for part in dict.fromkeys(row["id"].rpartition("-")[0] for row in rows):
            own = [row for row in rows if row["id"].startswith(f"{part}-")]
            hidden = [r for r in own if r["true_verdict"] == "missing_physics"]
            nulls = [r for r in own if r["true_verdict"] == "adequate"]
            counts = [sum(len(r["claimed"]) for r in own), sum(r["claims_right"] for r in own)]
            seconds = [r["wall"] for r in own]
            codes = sorted({(r.get("code") or "-")[:7] for r in own})
            link = f"[{part}](concealed-{name}.md)"
            lines.append(
                f"| {link} | {len(own)} | {share(hidden, 'first_right')} | {share(hidden, 'set_right')} "
                f"| {share(own, 'verdict_right')} | {counts[1]} of {counts[0]} "
                f"| {sum(r['detected'] for r in nulls)} of {len(nulls)} "
                f"| {median(seconds):.0f} ({max(seconds):.0f}) "
                f"| {codes[0] if len(codes) == 1 else f'{len(codes)} versions'} |"
            )
    return "\n".join(lines) + "\n"


def cases(rows: list[dict]) -> str:
    """A list of cases, one a row: what was concealed, what was said, and what that left."""
    lines = [
        "# Case by case",
        "",
        "Names in brackets were not confirmed. Errors are those of free runs of whole recordings over the noise, as a",
        "root mean square over channels; verdicts go by windows of 1 s, so that an error may rise beside a right name.",
        "Redrawn by `python experiments/concealed/run.py --figures`; do not edit.",
        "",
        "| case | concealed | verdict | named | hold-out error over the noise | s | version |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        version = (row.get("code") or "")[:7]
        error = "-" if row["before"] is None else f"{row['before']:.3g} to {row['after']:.3g}"
        concealed = ", ".join(row["true"]) or "nothing"
        named = ", ".join(n if n in row["claimed"] else f"({n})" for n in row["named"]) or "nothing"
        verdict = f"`{row['verdict']}`" if row["verdict"] else f"failed with status {row['status']}"
        lines.append(
            f"| {row['id']} | {concealed} | {verdict} | {named} | {error} | {row['wall']:.0f} | {version} |".replace(
                "_", " "
            )
        )
    return "\n".join(lines) + "\n"
