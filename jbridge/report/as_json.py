"""`report.json` and `fit.json`: for programs, in SI units; what is not known is null, never NaN."""

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..diagnosis.result import Diagnosis, NamedEffect
from ..identification.result import Errors, Estimate, Fit
from .text.rows import parts

SCHEMA = 1
INPUT_FILE = "next_experiment.csv"


def report_json(diagnosis: Diagnosis) -> str:
    """The text of `report.json`; the same diagnosis gives the same text."""
    return _as_text(
        {
            "schema": SCHEMA,
            "verdict": diagnosis.verdict,
            "complete": diagnosis.complete,
            "explained": {"all": None, **diagnosis.explained},
            "stopped": diagnosis.stopped,
            "statement": diagnosis.statement,
            "adequacy": _adequacy(diagnosis),
            "location": _location(diagnosis),
            "missing_force": _missing_force(diagnosis),
            "effects": [_effect(effect) for effect in diagnosis.effects],
            "model_effects": [_effect(effect) for effect in diagnosis.model_effects],
            "fit": _before_and_after(diagnosis),
            "not_seen": [dataclasses.asdict(row) for row in diagnosis.not_seen],
            "next_experiment": _next_experiment(diagnosis),
            "continued": None if diagnosis.continued is None else dataclasses.asdict(diagnosis.continued),
            "bridge": _estimates(diagnosis.bridge),
            "holdout": diagnosis.holdout,
            "trials": diagnosis.trials,
            "warnings": diagnosis.warnings,
            "notes": diagnosis.notes,
            "settings": diagnosis.settings,
            "seconds": diagnosis.seconds,
        }
    )


def fit_json(fit: Fit) -> str:
    """The text of `fit.json`, whose keys mean the same as those of `report.json`."""
    bridge, *effects = parts(fit)
    return _as_text(
        {
            "schema": SCHEMA,
            "bridge": _estimates(bridge.parameters),
            "model_effects": [
                {"kind": part.kind, "site": part.site, "parameters": _estimates(part.parameters)} for part in effects
            ],
            "fit": {
                "train": fit.train.free_run,
                "holdout": fit.holdout.free_run if fit.holdout else None,
                "noise": fit.noise,
                "window": {
                    "seconds": fit.window,
                    "train": fit.train.window,
                    "holdout": fit.holdout.window if fit.holdout else None,
                },
            },
            "warnings": fit.warnings,
            "notes": fit.notes,
            "seconds": fit.seconds,
        }
    )


def _adequacy(diagnosis: Diagnosis) -> dict[str, Any]:
    adequacy = diagnosis.adequacy
    return {
        "alarm": adequacy.alarm,
        "repeatable": {"before": adequacy.repeatable_before, "after": adequacy.repeatable_after},
        "channels": {
            name: {
                "rmse": channel.rmse,
                "noise": channel.noise,
                "ratio": channel.ratio if channel.noise else None,
            }
            for name, channel in adequacy.channels.items()
        },
    }


def _location(diagnosis: Diagnosis) -> dict[str, Any]:
    location = diagnosis.location
    return {
        "site": location.site,
        "equation": location.equation,
        "sites": location.sites,
        "where": [
            {"variable": region.variable, "low": region.low, "high": region.high, "share": region.share}
            for region in location.where
        ],
        "when": [
            {"recording": interval.recording, "start": interval.start, "stop": interval.stop}
            for interval in location.when
        ],
    }


def _missing_force(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """What the missing force is like; null where nothing is told of it."""
    likeness = diagnosis.location.likeness
    return None if likeness is None else {"likeness": dataclasses.asdict(likeness)}


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "kind": effect.kind,
        "site": effect.site,
        "probability": effect.probability,
        "status": effect.status,
        "in_model": effect.in_model,
        "recording": effect.recording,
        "explained": effect.explained,
        "parameters": _estimates(effect.parameters),
        "equivalents": [
            {
                "kind": rival.kind,
                "site": rival.site,
                "probability": rival.probability,
                "parameters": _estimates(rival.parameters),
                "holdout": rival.holdout,
            }
            for rival in effect.equivalents
        ],
        "statement": effect.statement,
    }


def _estimates(parameters: Mapping[str, Estimate]) -> dict[str, Any]:
    return {
        name: {
            "value": estimate.value,
            "std": estimate.std,
            "low": estimate.low,
            "high": estimate.high,
            "unit": estimate.unit,
        }
        for name, estimate in parameters.items()
    }


def _before_and_after(diagnosis: Diagnosis) -> dict[str, Any]:
    def pair(before: Errors, after: Errors, of: str) -> dict[str, Mapping[str, float]]:
        return {"before": getattr(before, of), "after": getattr(after, of)}

    train = diagnosis.train_before, diagnosis.train_after
    holdout = diagnosis.holdout_before, diagnosis.holdout_after
    return {
        "train": pair(*train, "free_run"),
        "holdout": pair(*holdout, "free_run"),
        "noise": diagnosis.noise,
        "window": {
            "seconds": diagnosis.window,
            "train": pair(*train, "window"),
            "holdout": pair(*holdout, "window"),
        },
        "horizons": [
            {
                "seconds": row.seconds,
                "holdout": {"before": row.before, "after": row.after},
                "typical": {"before": row.typical_before, "after": row.typical_after},
                "scatter": {axis: (row.scatter or {}).get(axis) for axis in row.before},
            }
            for row in diagnosis.horizons
        ],
    }


def _next_experiment(diagnosis: Diagnosis) -> dict[str, Any] | None:
    experiment = diagnosis.next_experiment
    if experiment is None:
        return None
    return {
        "purpose": experiment.purpose,
        "input": INPUT_FILE,
        "separates": experiment.separates,
        "expected_wrong": experiment.expected_wrong,
        "start": experiment.start,
    }


def _as_text(document: Mapping[str, Any]) -> str:
    return json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """A value in JSON's own types; numbers that are not finite become null."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray | np.generic) or hasattr(value, "__array__"):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, Iterable):
        entries = sorted(value) if isinstance(value, set | frozenset) else value
        return [_plain(entry) for entry in entries]
    return str(value)
