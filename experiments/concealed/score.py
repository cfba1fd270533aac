"""Scores one diagnosis: a truth and a report in, a row out. No files, no clock."""

import math
from bisect import bisect_right
from statistics import median

from cases import ALSO_EQUIVALENT

CHANNELS = ("x", "psi", "l")
NO_NUMBER = {"kind", "site", "encoder", "end", "length", "knots"}
"""Keys of an effect that are not estimated numbers."""
FRESH = {"phase"}
"""Compared in turns: an error is a share of a full turn."""


def label(effect: dict) -> str:
    return f"{effect['kind']} {effect['site']}"


def accepted(truth: dict) -> dict[str, set[str]]:
    """For each concealed effect the labels that count as it: itself and what cannot be told apart."""
    names = {label(e): {label(e)} for e in truth["concealed"]}
    for e in truth["equivalents"]:
        names[e["for"]].add(label(e))
    # Those that were found after a part was sealed are equivalents of its cases as well.
    for (flavour, name), others in ALSO_EQUIVALENT.items():
        if flavour == truth["flavour"] and name in names:
            names[name] |= {other for other, _ in others}
    return names


def matches(named: list[str], wanted: dict[str, set[str]]) -> dict[str, str]:
    """Pairs each concealed effect with one named effect: {true label: named label}."""
    pairs: dict[str, str] = {}
    for true, names in wanted.items():
        free = [n for n in named if n not in pairs.values()]
        found = true if true in free else next((n for n in free if n in names), None)
        if found:
            pairs[true] = found
    return pairs


def at_reference(truth: dict, length: float | None) -> tuple[dict, list[dict]]:
    """The truth's numbers, rewritten for another reference rope length: the same law, other numbers.

    K (1 + s (l - L0)) is K' (1 + s' (l - L1)) with K' = K (1 + s (L1 - L0)), s' = s K / K'. Likewise the
    damping R + s (l - L0).
    """
    bridge, concealed = dict(truth["bridge"]), [dict(e) for e in truth["concealed"]]
    for e in concealed:
        if length is None or "length" not in e:
            continue
        away = length - e["length"]
        if e["kind"] == "drum_radius_change":
            factor = 1.0 + e["slope"] * away
            bridge["hoist_gain"] *= factor
            e["slope"] /= factor
        elif e["kind"] == "length_dependent_damping":
            bridge["swing_damping"] += e["slope"] * away
        e["length"] = length
    return bridge, concealed


def _curve(knots: list[float], values: list[float], x: float) -> float:
    if x <= knots[0] or len(knots) == 1:
        return values[0]
    if x >= knots[-1]:
        return values[-1]
    i = bisect_right(knots, x)
    return values[i - 1] + (values[i] - values[i - 1]) * (x - knots[i - 1]) / (knots[i] - knots[i - 1])


def _curve_errors(true: dict, found: dict) -> dict:
    """Curves over knots are compared as curves, each with its smallest level at 0, at the true knots."""
    names = [k for k in ("levels", "positive", "negative") if k in true]
    try:
        knots = found["knots"]["value"]
        curves = {k: [_curve(knots, found[k]["value"], x) for x in true["knots"]] for k in names}
    except (KeyError, TypeError, IndexError):
        return {}
    floor = min(min(c) for c in curves.values())
    away = [abs(v - floor - w) for k in names for v, w in zip(curves[k], true[k], strict=True)]
    size = [w for k in names for w in true[k]]
    return {"/".join(names): {"error": sum(away) / max(sum(size), 1e-12), "covered": None}}


def _number(name: str, true: float, found: dict | None) -> dict | None:
    """Relative error and whether the 95 % interval covers; None where the truth is 0 or nothing is said."""
    if not found or not isinstance(found.get("value"), int | float) or true == 0.0:
        return None
    value, low, high = float(found["value"]), found.get("low"), found.get("high")
    if name in FRESH:
        turn = 2 * math.pi
        shift = turn * round((value - true) / turn)
        value = value - shift
        low, high = (None if b is None else b - shift for b in (low, high))
        error = abs(value - true) / turn
    else:
        error = abs(value - true) / abs(true)
    covered = None if low is None or high is None else bool(low <= true <= high)
    return {"true": true, "value": value, "error": error, "covered": covered}


def parameter_errors(true: dict, found: dict) -> dict:
    """Errors of one effect's numbers.

    A negative amplitude is read as a shifted phase, a scale as its deviation from 1.
    """
    if "knots" in true:
        return _curve_errors(true, found)
    found = {k: dict(v) if isinstance(v, dict) else v for k, v in found.items()}
    if "amplitude" in found and "phase" in found and (found["amplitude"]["value"] or 0.0) < 0:
        amplitude, phase = found["amplitude"], found["phase"]
        found["amplitude"] = amplitude | {
            "value": -amplitude["value"],
            "low": None if amplitude.get("high") is None else -amplitude["high"],
            "high": None if amplitude.get("low") is None else -amplitude["low"],
        }
        found["phase"] = {k: v + math.pi if isinstance(v, int | float) else v for k, v in phase.items()}
    if true["kind"] == "wrong_value":  # the report may call the number by the parameter's name
        found = {"value": found.get("value") or found.get(true["site"])}
    rows = {}
    for name, value in true.items():
        if name in NO_NUMBER or not isinstance(value, int | float):
            continue
        other = found.get(name)
        if name == "scale" and isinstance(other, dict) and other.get("value") is not None:
            shift = {k: None if other.get(k) is None else other[k] - 1 for k in ("value", "low", "high")}
            row = _number(name, value - 1, shift)
        else:
            row = _number(name, value, other)
        if row:
            rows[name] = row
    return rows


LOCAL = {
    "brake_zone": lambda e: ("x", e["centre"] - e["width"], e["centre"] + e["width"]),
    "swing_guide": lambda e: ("psi", e["angle"], math.inf),
    "end_stop": lambda e: ("x", e["position"], math.inf),
}
"""Effects that act along part of a variable, and where."""
SPAN = {"wind": lambda e: (e["start"], e["stop"])}
JUMP = {"missed_counts": lambda e: e["time"]}
"""Effects that act for a time, or at one, in every recording."""


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> float:
    """What two intervals share, over what they cover. An open end goes as far as the other interval."""
    top = b[1] if math.isinf(a[1]) else max(a[1], b[1])
    shared = min(a[1], b[1]) - max(a[0], b[0])
    return max(shared, 0.0) / max(top - min(a[0], b[0]), 1e-12)


def placed(truth: dict, report: dict) -> dict:
    """How well local effects were located: overlap over what both cover, or the error of a jump's time [s].

    Of times the median over the recordings that the report speaks of.
    """
    where, when = report["location"].get("where", []), report["location"].get("when", [])
    spans: dict[str, list[tuple[float, float]]] = {}
    for i in when:
        spans.setdefault(i["recording"], []).append((i["start"], i["stop"]))
    found = {}
    for e in truth["concealed"]:
        if e["kind"] in LOCAL:
            name, low, high = LOCAL[e["kind"]](e)
            own = [(r["low"], r["high"]) for r in where if r["variable"] == name]
            found[label(e)] = {"overlap": max((_overlap((low, high), o) for o in own), default=0.0)}
        elif e["kind"] in SPAN:
            best = [max(_overlap(SPAN[e["kind"]](e), s) for s in own) for own in spans.values()]
            found[label(e)] = {"overlap": median(best) if best else 0.0}
        elif e["kind"] in JUMP:
            errors = [min(abs(0.5 * (a + b) - JUMP[e["kind"]](e)) for a, b in own) for own in spans.values()]
            found[label(e)] = {"late": median(errors) if errors else None}
    return found


def holdout(report: dict, when: str) -> float | None:
    """Free-run error on the hold-out recordings, root mean square over channels, each over its noise."""
    errors, noise = report["fit"]["holdout"][when], report["fit"]["noise"]
    ratios = [errors[c] / noise[c] for c in CHANNELS if errors.get(c) is not None and noise.get(c)]
    return math.sqrt(sum(r * r for r in ratios) / len(ratios)) if ratios else None


def nested(report: dict) -> dict:
    """How many models with an effect more were fitted, how many of them ended worse than the model that they contain,
    and how many would have, had they not been fitted again from there."""
    moves: dict[tuple, list[dict]] = {}
    for trial in report.get("trials", []):
        moves.setdefault((trial["round"], trial["gain"], trial["price"]), []).append(trial)
    # What takes the place of another effect contains no other model.
    larger = [own for own in moves.values() if all(t["change"] == "added" for t in own)]
    trials = [t for own in larger for t in own]
    worse = sum(t["gain"] < -1e-6 for t in trials)
    return {"larger": len(trials), "worse": worse, "restarted": sum(t.get("restarted", False) for t in trials)}


def score(truth: dict, report: dict | None, mean_length: float | None = None) -> dict:
    """One row of the proof's table.

    Args:
        truth: as sealed.
        report: the content of report.json, or None where the diagnosis failed.
        mean_length: mean rope length of the training recordings [m], the reference where a report gives none.

    Returns:
        What was true, what was said, and whether it was right: `verdict_right`, `detected`, `equation_right`,
        `first_right` (the first effect named is true or accepted), `in_set` (or one of its declared
        equivalents is), `claimed` and `claims_right` (what the hold-out confirmed, and how many of
        them are true or accepted), `set_right` (of these nothing missing, nothing superfluous), `parameters`, `bridge`,
        `gap_closed`, `seconds`.
    """
    wanted = accepted(truth)
    row = {
        "id": truth["id"], "flavour": truth["flavour"], "loop": truth["loop"],
        "true": [label(e) for e in truth["concealed"]], "true_verdict": truth["verdict"],
        "true_equations": truth["equations"], "named": [], "verdict": "failed", "verdict_right": False,
        "detected": False, "equation": None, "equation_right": False, "first_right": False, "in_set": False,
        "set_right": False, "claimed": [], "claims_right": 0,
        "parameters": {}, "bridge": {}, "before": None, "after": None, "gap_closed": None,
        "seconds": None, "probability": None, "placed": {},
    }  # fmt: skip
    if report is None:
        return row
    effects = report["effects"]
    named = [label(e) for e in effects]
    rivals = {label(e) for e in effects[0].get("equivalents", [])} if effects else set()
    # What the hold-out did not confirm is listed, and not claimed; reports of earlier versions claim all they list.
    claimed = [label(e) for e in effects if e.get("status", "confirmed") == "confirmed"]
    pairs = matches(claimed, wanted)
    everything = set().union(*wanted.values()) if wanted else set()
    before, after = holdout(report, "before"), holdout(report, "after")
    row |= {
        "named": named, "verdict": report["verdict"], "verdict_right": report["verdict"] == truth["verdict"],
        "detected": report["verdict"] != "adequate", "equation": report["location"]["equation"],
        "equation_right": report["location"]["equation"] in truth["equations"],
        "first_right": bool(named) and named[0] in everything,
        "in_set": bool(named) and bool(({named[0]} | rivals) & everything),
        "set_right": len(pairs) == len(wanted) == len(claimed),
        "claimed": claimed, "claims_right": len(pairs),
        "probability": effects[0].get("probability") if effects else None, "before": before, "after": after,
        "seconds": report.get("seconds"), "placed": placed(truth, report), **nested(report),
    }  # fmt: skip
    if before is not None and after is not None and before > 1.0:
        row["gap_closed"] = (before - after) / (before - 1.0)
    tables = {label(e): e.get("parameters", {}) for e in effects}
    lengths = [t["length"]["value"] for t in tables.values() if isinstance(t.get("length"), dict)]
    bridge, concealed = at_reference(truth, lengths[0] if lengths else mean_length)
    for e in concealed:
        if pairs.get(label(e)) == label(e):
            errors = parameter_errors(e, tables[label(e)])
            row["parameters"] |= {f"{label(e)}.{name}": error for name, error in errors.items()}
    exact = row["set_right"] and all(a == b for a, b in pairs.items())
    if exact and report["verdict"] == truth["verdict"]:  # only then do the rig's own numbers mean the same
        for name in truth["model"]["bridge"]:
            found = _number(name, bridge[name], report.get("bridge", {}).get(name)) if name in bridge else None
            if found and name not in truth["model"]["bridge"]["known"]:
                row["bridge"][name] = found
        played = {label(e): e for e in truth["effects"]}
        for e in report.get("model_effects", []):
            if label(e) in played:
                errors = parameter_errors(played[label(e)], e.get("parameters", {}))
                row["bridge"] |= {f"{label(e)}.{name}": error for name, error in errors.items()}
    return row
