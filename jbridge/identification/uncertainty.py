"""How well recordings determine parameters, and what they do not determine."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..model.names import number_name
from ..model.parameters import Entry, ParameterTable
from .estimation import Problem
from .result import Estimate
from .sensitivity.engine import Engine
from .solver import Point

_NORMAL = 1.959964
_FACTOR, _SHARE = 2.0, 0.0025
"""What a standard deviation is multiplied by, and the share of the value that is added to it (in quadrature): an engine
is not a rig, and their difference is not noise. Chosen on concealed cases that another engine played
(experiments/concealed/calibrate.py), where the plain intervals cover 41 % and these 95 %."""
_UNTOLD = 1e9
"""Standard deviation, over the value or one unit, beyond which a number shows in nothing that was recorded."""
_WELL = 0.05
"""Standard deviation over its number up to which the number is known well."""
_CLOCK = 0.01
"""Share of the sampling period that is added to the standard deviation of a time: nobody knows better when a sample was
taken and when an input acted, and two engines differ by up to this in the delays of the same recordings."""


def covariance(problem: Problem, engine: Engine, point: Point) -> NDArray[np.float64]:
    """Covariance of the free parameters at a fit, initial states eliminated: the criterion's curvature, inverted.

    Its effective numbers of samples account for residuals that are neither as large as the noise nor independent.
    """
    [normal] = problem.normal(engine, [point])
    n = len(point.free)
    total = problem.likelihood.weighted(point.square, normal.products)[:n, :n]
    precision, _ = problem.likelihood.prior.terms(engine.table, point.free, point.vector, np.diag(total))
    return inverse_normal(total + precision)


def inverse_normal(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse of a normal matrix, scaled first; directions that the data do not determine come out large."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-200))
    scaled = matrix / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return inverse / np.outer(scale, scale)


def widened(stds: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations with what an engine's difference from a rig adds."""
    return np.hypot(_FACTOR * stds, _SHARE * values)


def _untold(std: float, value: float) -> bool:
    """Whether nothing that was recorded depends on a number: then its standard deviation is rounding."""
    return bool(std > _UNTOLD * max(abs(value), 1.0))


def estimates(
    table: ParameterTable,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    cov: NDArray[np.float64],
    period: float,
) -> dict[str, Estimate]:
    """Every parameter of a table with its 95 % interval; what was not estimated, or told by nothing, has none.

    An entry of a vector that nothing tells of has an infinite standard deviation and what its bounds allow.

    Args:
        table: of the model.
        vector: its parameters.
        free: places of those that were estimated.
        cov: their covariance.
        period: sampling period of the recordings [s].
    """
    clock = [_CLOCK * period if table.entry(int(place)).unit == "s" else 0.0 for place in free]
    wide = np.hypot(widened(np.sqrt(np.maximum(np.diag(cov), 0.0)), vector[free]), np.array(clock))
    stds = {
        int(place): math.inf if _untold(float(std), float(vector[place])) else float(std)
        for place, std in zip(free, wide, strict=True)
    }
    low_all, high_all = table.bounds()
    groups: dict[str, list[int]] = {}
    for entry in table.entries:
        groups.setdefault(entry.group, table.positions(entry.group))
    out = {}
    for group, places in groups.items():
        info, unit = table.entry(places[0]).info, table.entry(places[0]).unit
        values = [float(vector[p]) for p in places]
        spread = [stds.get(p) for p in places]
        lows = [
            None if s is None else max(v - _NORMAL * s, low_all[p])
            for v, s, p in zip(values, spread, places, strict=True)
        ]
        highs = [
            None if s is None else min(v + _NORMAL * s, high_all[p])
            for v, s, p in zip(values, spread, places, strict=True)
        ]
        if info.vector:
            estimated = any(s is not None for s in spread)
            # A level that is held as the reference of its neighbours is exact by choice.
            full = [0.0 if s is None else s for s in spread]
            out[group] = Estimate(
                values,
                full if estimated else None,
                [v if x is None else x for v, x in zip(values, lows, strict=True)] if estimated else None,
                [v if x is None else x for v, x in zip(values, highs, strict=True)] if estimated else None,
                unit,
            )
        elif spread[0] == math.inf:
            out[group] = Estimate(values[0], None, None, None, unit)
        else:
            out[group] = Estimate(values[0], spread[0], lows[0], highs[0], unit)
    return out


def warnings(
    table: ParameterTable,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    cov: NDArray[np.float64],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> list[str]:
    """What the recordings cannot determine, in sentences.

    Args:
        table: of the model.
        vector: its parameters.
        free: places of those that were estimated.
        cov: their covariance.
        bounds: lower and upper ones of all parameters, between which they were estimated.
    """
    out = []
    stds = np.sqrt(np.maximum(np.diag(cov), 0.0))
    wide = widened(stds, vector[free])
    low, high = bounds
    loose: dict[str, list[int]] = {}
    entries = [table.entry(int(place)) for place in free]
    uncertain = [bool(wide[i] > 0.5 * max(abs(vector[place]), 1e-9)) for i, place in enumerate(free)]
    # What is known well beside another number is told apart from it, however much they have to do with each other.
    well = wide <= _WELL * np.abs(vector[free])
    together = [m for m in _inseparable(entries, stds, cov) if not well[m].all()]
    for i, place in enumerate(free):
        entry = entries[i]
        name, value = number_name(entry.name), f"{vector[place]:.3g} {entry.unit}".removesuffix(" 1")
        if uncertain[i] and entry.info.vector:
            loose.setdefault(entry.group, []).append(i)
        elif vector[place] <= low[place] or vector[place] >= high[place]:
            out.append(f"The {name} ended at its bound of {value}.")
        elif uncertain[i] and _untold(float(wide[i]), float(vector[place])):
            out.append(f"The recordings contain no information on the {name}, which stays at {value}.")
        elif uncertain[i] and not any(i in members for members in together):
            out.append(f"The recordings hardly determine the {name}: {value} ± {_NORMAL * wide[i]:.2g}.")
    for group, members in loose.items():
        count = len(table.positions(group))
        out.append(
            f"The recordings hardly determine {len(members)} of the {count} values of the {number_name(group)}: "
            "trust their shape, not their level."
        )
    for members in together:
        listed = _listed([number_name(entries[i].name) for i in members])
        scale = all(uncertain[i] and entries[i].is_force for i in members)
        if scale and any(entries[i].name.endswith("_mass") for i in members):
            out.append(
                f"The recordings hardly determine a factor that {listed} have in common: no force of known size acts "
                "on them that shows in the recordings. Only their ratios are reliable; list a mass that was weighed "
                "under known."
            )
        else:
            out.append(
                f"The recordings hardly separate {listed}: only combinations of them are determined."
                f"{_parted_by([entries[i] for i in members])}"
            )
    return out


_SHOWN_BY = (
    (("load_mass",), "another load"),
    (("mass", "inertia", "centre"), "quick changes of speed"),
    (("delay", "time_constant"), "sudden steps of the input"),
    (("l_sensor", "drum_radius_change", "length_dependent_damping"), "several rope lengths"),
    (("psi_sensor", "load_drag", "power_law_damping", "exponent"), "wide swings and small ones"),
    (("x_sensor", "stiffness", "rest", "period", "phase", "amplitude", "position"), "runs over the whole rail"),
    (("gain", "ratio", "limit", "cart_drive", "hoist_drive", "constant"), "inputs of several sizes"),
    (("damping", "coefficient", "velocity", "share"), "steady runs at several speeds"),
    (("level", "positive", "negative", "breakaway", "rate"), "slow runs in both directions"),
)
"""What a number does shows most in which recordings; the first line that has a word of its name."""


def _parted_by(entries: Sequence[Entry]) -> str:
    """Recordings that would tell numbers apart, each by what it does most."""
    found = []
    for entry in entries:
        words = set(entry.group.replace("@", ".").split(".")) | {entry.key, entry.key.rpartition("_")[2]}
        found += [shown for keys, shown in _SHOWN_BY if words & set(keys)][:1]
    told = list(dict.fromkeys(found))
    return f" {_listed(told).capitalize()} would separate them." if told else ""


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)


def _inseparable(entries: Sequence[Entry], stds: NDArray[np.float64], cov: NDArray[np.float64]) -> list[list[int]]:
    """Parameters of which only combinations are determined, in groups; entries of lists are not among them."""
    alone = np.array([not entry.info.vector for entry in entries], bool)
    both = np.outer(stds, stds)
    tied = (np.abs(cov) > 0.995 * both) & (both > 0) & np.outer(alone, alone)
    count, group = connected_components(tied, directed=False)
    members = [np.flatnonzero(group == g).tolist() for g in range(count)]
    return [m for m in members if len({entries[i].group for i in m}) > 1]


def as_uncertainty(found: Mapping[str, Estimate]) -> dict[str, dict[str, object]]:
    """Intervals as a model file keeps them."""
    return {name: {"std": e.std, "low": e.low, "high": e.high} for name, e in found.items() if e.std is not None}
