"""The part of the page that moves: linked curves and a replay, drawn by `assets/report.js` from numbers in the page."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis.result import Diagnosis, NamedEffect
from ..identification.result import Trace
from .figures.friction_map import KINDS
from .figures.gallery import choose
from .text.quantities import as_list, error_scale, pretty_unit
from .text.rows import is_changed, units_of
from .text.words import CHANNELS, capital, effect_name, input_units

MOST_POINTS = 2000
"""Points of a curve at most."""
_DEGREES = 180.0 / np.pi


def report_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the script draws, in the units shown; null where a number is not known or not finite."""
    units = input_units(units_of(diagnosis.bridge))
    changed = is_changed(diagnosis)
    return {
        "labels": {"before": "before", "after": "after" if changed else "simulated"},
        "recordings": [
            _recording(trace, units, changed)
            for trace in choose(diagnosis.traces, diagnosis.noise, diagnosis.location.when)
        ],
        "horizons": _horizons(diagnosis, changed),
        "maps": [found for effect in (*diagnosis.effects, *diagnosis.model_effects) if (found := _map(effect))],
    }


def _recording(trace: Trace, units: Mapping[str, str], changed: bool) -> dict[str, Any]:
    every = slice(None, None, max(-(-len(trace.times) // MOST_POINTS), 1))
    runs = {"recorded": trace.measured, **({"before": trace.before} if changed else {}), "after": trace.after}
    panels = []
    for channel in CHANNELS:
        factor, unit, decimals = (_DEGREES, "°", 4) if channel == "psi" else (1.0, "m", 6)
        curves = [
            {"label": role, "role": role, "values": _numbers(factor * run[channel][every], decimals)}
            for role, run in runs.items()
            if channel in run
        ]
        if curves:
            scale = error_scale(channel)
            residual = {"label": f"residual [{scale.unit}]", "factor": scale.factor / factor}
            label = f"{CHANNELS[channel]} [{unit}]"
            panels.append({"label": label, "channel": channel, "curves": curves, "residual": residual})
    for name, values in trace.inputs.items():
        curve = {"label": name, "role": "recorded", "values": _numbers(values[every])}
        panels.append({"label": f"{name} [{pretty_unit(units.get(name, 'V'))}]", "curves": [curve]})
    return {
        "name": f"{trace.recording} ({'hold-out' if trace.role == 'holdout' else 'training'})",
        "t": _numbers(trace.times[every]),
        "panels": panels,
        "scene": _scene(trace),
    }


def _scene(trace: Trace) -> dict[str, Any]:
    """The length of the rope [m], null where there is none, and the box that the motion of pivot and load fills [m].

    Simulations widen the box by half of its size at most: one that runs away leaves the scene.
    """
    hangs = "psi" in trace.measured or "l" in trace.measured
    lengths = _finite(trace.coordinates.get("l") if hangs else None)
    rope = float(f"{np.median(lengths):.6g}") if lengths.size else None
    rig, *simulated = (_box(run, rope) for run in (trace.measured, trace.before, trace.after))
    margin = max(rig[1] - rig[0], rig[3] - rig[2]) / 2
    widened = np.clip([rig, *simulated], rig - margin, rig + margin)
    names = ("left", "right", "top", "bottom")
    ends = (widened[:, k].min() if name in ("left", "top") else widened[:, k].max() for k, name in enumerate(names))
    return {"rope": rope, **dict(zip(names, map(float, ends), strict=True))}


def _box(run: Mapping[str, NDArray[np.float64]], rope: float | None) -> NDArray[np.float64]:
    """Leftmost, rightmost, highest and lowest place of pivot and load [m], the heights downwards from the pivot."""
    x, psi, lengths = (_finite(run.get(axis)) for axis in CHANNELS)
    x, psi = (each if each.size else np.zeros(1) for each in (x, psi))
    longest = lengths.max(initial=0.0) if lengths.size else rope or 0.0
    across, down = (np.append(longest * turn(psi), 0.0) for turn in (np.sin, np.cos))
    return np.array([x.min() + across.min(), x.max() + across.max(), down.min(), down.max()])


def _horizons(diagnosis: Diagnosis, changed: bool) -> list[dict[str, Any]]:
    rows = diagnosis.horizons if len(diagnosis.horizons) > 1 else ()
    panels = []
    for channel in CHANNELS:
        if not any(channel in row.after for row in rows):
            continue
        scale = error_scale(channel)
        curves = [
            {"label": side, "role": side, "values": _positive([getattr(row, side).get(channel) for row in rows], scale)}
            for side in (("before", "after") if changed else ("after",))
        ]
        noise = {"label": "noise", "role": "recorded"}
        curves.append({**noise, "values": _positive([diagnosis.noise.get(channel)] * len(rows), scale)})
        label = f"Hold-out error over horizon: {CHANNELS[channel]}"
        seconds, axis = [row.seconds for row in rows], f"rms error [{scale.unit}]"
        panels.append({"label": label, "axis": axis, "seconds": seconds, "curves": curves})
    return panels


def _positive(values: Sequence[float | None], scale: Any) -> list[float | None]:
    """Numbers for a logarithmic axis, which shows none that are zero."""
    return [scale.factor * v if v is not None and np.isfinite(v) and v > 0 else None for v in values]


def _map(effect: NamedEffect) -> dict[str, Any] | None:
    """Force by place and direction, with its intervals; None for an effect that is no map."""
    if effect.kind not in KINDS or "knots" not in effect.parameters:
        return None
    curves = []
    for key, (said, role) in {
        "levels": ("both directions", "after"),
        "positive": ("towards larger values", "after"),
        "negative": ("towards smaller values", "before"),
    }.items():
        estimate = effect.parameters.get(key)
        for values, bound in (
            ((estimate.value, ""), (estimate.low, ", 95 % low"), (estimate.high, ", 95 % high")) if estimate else ()
        ):
            if values is not None:
                numbers = _numbers(np.array(as_list(values), dtype=np.float64))
                curves.append({"label": said + bound, "role": role, "bound": bool(bound), "values": numbers})
    unit = next((effect.parameters[key].unit for key in ("levels", "positive") if key in effect.parameters), "N")
    return {
        "label": capital(effect_name(effect.kind, effect.site)),
        "place": "rope length l [m]" if effect.site == "hoist" else "cart position x [m]",
        "force": f"friction [{pretty_unit(unit)}]",
        "places": _numbers(np.array(as_list(effect.parameters["knots"].value), dtype=np.float64)),
        "curves": curves,
    }


def _finite(values: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return np.empty(0) if values is None else values[np.isfinite(values)]


def _numbers(values: NDArray[np.float64], decimals: int | None = None) -> list[float | None]:
    """Six significant digits, or so many decimals, are finer than a screen; a run that goes astray is cut off."""
    rounded = (round(value, decimals) if decimals is not None else float(f"{value:.6g}") for value in values.tolist())
    return [value if abs(value) < 1e6 else None for value in rounded]
