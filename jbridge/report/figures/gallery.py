"""Which figures a report shows, of which recordings."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..._types import AXIS_OF_EQUATION
from ...diagnosis.result import Diagnosis, Interval, NamedEffect, Region
from ...identification.result import Errors, Fit, Trace
from ...prediction import Simulation
from ..text.rows import parts, units_of
from ..text.words import input_units
from .friction_map import draw_friction_map
from .horizons import draw_horizons
from .improvement import draw_improvement
from .missing_force import draw_missing
from .residual_force import draw_force
from .residuals import draw_residuals
from .signals import draw_signals
from .sites import draw_evidence
from .style import Picture, drawable

_DIAGNOSED = ("model as given, refitted", "final model")
_FITTED = ("model as given", "fitted model")
_MOST_HOLDOUTS = 3
OWN_NAME = re.compile(
    r"(improvement|error-over-horizon|places|(missing-)?force-(x|psi|l)|(signals|residuals)-(train|holdout)-.+"
    r"|friction-map-position-(dependent|direction)-friction-.+)\.png"
)
"""What the files of figures are called."""


@dataclass(frozen=True)
class Gallery:
    """The figures of a report by what they answer."""

    improvement: tuple[Picture, ...] = ()
    evidence: tuple[Picture, ...] = ()
    missing: tuple[Picture, ...] = ()
    forces: tuple[Picture, ...] = ()
    maps: Mapping[tuple[str, str], Picture] | None = None
    """By kind and site of the effect."""
    signals: tuple[Picture, ...] = ()
    residuals: tuple[Picture, ...] = ()

    def all(self) -> tuple[Picture, ...]:
        maps = tuple((self.maps or {}).values())
        return (*self.improvement, *self.evidence, *self.missing, *self.forces, *maps, *self.signals, *self.residuals)


def diagnosis_gallery(diagnosis: Diagnosis) -> Gallery:
    units = input_units(units_of(diagnosis.bridge))
    location = diagnosis.location
    traces = choose(diagnosis.traces, diagnosis.noise, location.when)
    labels = _labels(diagnosis.traces, _DIAGNOSED, alone=_DIAGNOSED[0])
    return Gallery(
        improvement=(
            *_present(draw_horizons("error-over-horizon", diagnosis.horizons, diagnosis.noise, labels)),
            *_improvement(diagnosis.holdout_before, diagnosis.holdout_after, diagnosis.noise, diagnosis.window, labels),
        ),
        evidence=_present(draw_evidence("places", location.sites, location.site)),
        missing=_missing(diagnosis, units),
        forces=_forces(diagnosis.traces, AXIS_OF_EQUATION.get(location.equation), location.where, units, labels),
        maps=_maps((*diagnosis.effects, *diagnosis.model_effects)),
        signals=tuple(draw_signals(_name("signals", trace), trace, units, labels) for trace in traces),
        residuals=tuple(
            draw_residuals(_name("residuals", trace), trace, diagnosis.noise, location.when, labels) for trace in traces
        ),
    )


def fit_gallery(fit: Fit) -> Gallery:
    bridge, *effects = parts(fit)
    units = input_units(units_of(bridge.parameters))
    traces = choose(fit.traces, fit.noise, ())
    labels = _labels(fit.traces, _FITTED, alone=_FITTED[1])
    return Gallery(
        maps=_maps(
            [
                NamedEffect(
                    kind=part.kind or "",
                    site=part.site or "",
                    probability=None,
                    parameters=part.parameters,
                    equivalents=(),
                    statement="",
                )
                for part in effects
            ]
        ),
        signals=tuple(draw_signals(_name("signals", trace), trace, units, labels) for trace in traces),
        residuals=tuple(draw_residuals(_name("residuals", trace), trace, fit.noise, (), labels) for trace in traces),
    )


def diagnosis_signals(diagnosis: Diagnosis, recording: str | None = None) -> Picture:
    """One recording of a diagnosis with its simulations.

    Args:
        diagnosis: the result.
        recording: its name; by default the first that a report shows.
    """
    trace = _trace(diagnosis.traces, recording, diagnosis.noise)
    units = input_units(units_of(diagnosis.bridge))
    labels = _labels(diagnosis.traces, _DIAGNOSED, alone=_DIAGNOSED[0])
    return draw_signals(_name("signals", trace), trace, units, labels)


def fit_signals(fit: Fit, recording: str | None = None) -> Picture:
    """The same of a fit."""
    trace = _trace(fit.traces, recording, fit.noise)
    units = input_units(units_of(parts(fit)[0].parameters))
    return draw_signals(_name("signals", trace), trace, units, _labels(fit.traces, _FITTED, alone=_FITTED[1]))


def simulation_signals(simulation: Simulation) -> Picture:
    """A simulation, beside what was recorded."""
    recording, absent = simulation.recording, np.full(len(simulation["t"]), np.nan)
    simulated = {channel: simulation[channel] for channel in ("x", "psi", "l") if channel in simulation}
    measured = {
        channel: absent if getattr(recording, channel) is None else getattr(recording, channel) for channel in simulated
    }
    inputs = {name: simulation[name] for name in ("u_x", "u_l") if name in simulation}
    trace = Trace(
        recording=recording.name,
        role="simulated",
        times=recording.times - recording.start,
        inputs=inputs,
        measured=measured,
        before={},
        after=simulated,
        coordinates={},
        velocities={},
        force_before={},
        force_after={},
    )
    return draw_signals(_name("signals", trace), trace, recording.units, ("", "simulated"))


def _trace(traces: Sequence[Trace], recording: str | None, noise: Mapping[str, float]) -> Trace:
    if recording is None:
        return choose(traces, noise, ())[0]
    found = [trace for trace in traces if trace.recording == recording]
    if not found:
        raise ValueError(f"no recording {recording!r}; there are {', '.join(trace.recording for trace in traces)}")
    return found[0]


def choose(traces: Sequence[Trace], noise: Mapping[str, float], when: Sequence[Interval]) -> list[Trace]:
    """The hold-out recordings, the training recording that is met worst, and the first in which the mismatch sits."""
    holdouts = [trace for trace in traces if trace.role == "holdout"][:_MOST_HOLDOUTS]
    training = [trace for trace in traces if trace.role == "train"]
    worst = sorted(training, key=lambda trace: -misfit(trace, noise))[:1]
    named = [trace for interval in when[:1] for trace in training if trace.recording == interval.recording]
    chosen = {id(trace): trace for trace in (*holdouts, *worst, *named)}
    return list(chosen.values())


def misfit(trace: Trace, noise: Mapping[str, float]) -> float:
    """Largest rms error of the simulation before, as a multiple of the noise, over the channels."""
    ratios = [0.0]
    for channel, measured in trace.measured.items():
        if channel not in trace.before:
            continue
        left = (measured - drawable(trace.before[channel]))[np.isfinite(measured)]
        if left.size and noise.get(channel):
            ratio = float(np.sqrt(np.mean(left**2))) / noise[channel]
            # A run that goes astray is the worst of all.
            ratios.append(ratio if np.isfinite(ratio) else np.inf)
    return max(ratios)


def _labels(traces: Sequence[Trace], labels: tuple[str, str], alone: str) -> tuple[str, str]:
    """The names of the simulations; where both are the same, one goes by the name `alone` and the other is left out."""
    same = all(
        np.array_equal(values, trace.after.get(channel, np.empty(0)), equal_nan=True)
        for trace in traces
        for channel, values in trace.before.items()
    )
    return ("", alone) if same else labels


def _improvement(
    before: Errors, after: Errors, noise: Mapping[str, float], window: float, labels: tuple[str, str]
) -> tuple[Picture, ...]:
    return _present(draw_improvement("improvement", before, after, noise, window, labels))


def _missing(diagnosis: Diagnosis, units: Mapping[str, str]) -> tuple[Picture, ...]:
    axis = AXIS_OF_EQUATION.get(diagnosis.location.equation)
    if axis is None:
        return ()
    return _present(draw_missing(f"missing-force-{axis}", diagnosis.location, diagnosis.traces, axis, units))


def _forces(
    traces: Sequence[Trace],
    axis: str | None,
    where: Sequence[Region],
    units: Mapping[str, str],
    labels: tuple[str, str],
) -> tuple[Picture, ...]:
    """The axis at fault; all axes where none is."""
    training = [trace for trace in traces if trace.role == "train"] or list(traces)
    axes = [axis] if axis else ["x", "psi", "l"]
    pictures = [
        draw_force(f"force-{other}", training, other, where if other == axis else (), units, labels) for other in axes
    ]
    return tuple(picture for picture in pictures if picture is not None)


def _maps(effects: Sequence[NamedEffect]) -> Mapping[tuple[str, str], Picture]:
    pictures = {
        (effect.kind, effect.site): draw_friction_map(
            f"friction-map-{_slug(effect.kind)}-{_slug(effect.site)}", effect.kind, effect.site, effect.parameters
        )
        for effect in effects
    }
    return {key: picture for key, picture in pictures.items() if picture is not None}


def _present(picture: Picture | None) -> tuple[Picture, ...]:
    return () if picture is None else (picture,)


def _name(prefix: str, trace: Trace) -> str:
    return f"{prefix}-{_slug(trace.role)}-{_slug(trace.recording.rpartition('.')[0] or trace.recording)}"


def _slug(text: str) -> str:
    """A piece of a file name from a name that may hold anything."""
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-")[:60] or "unnamed"
