"""What these recordings could not have shown: how large each effect that was not named may still be.

`looks` gives an estimate and a covariance for every seed of every effect that the final model lacks. An upper 95 %
bound is `|estimate| + 1.96 std`, with the standard deviation widened as every interval here
(`identify.uncertainty`). Over the seeds of one effect (periods, places, times) the largest estimate and the largest
deviation count, since what lies between two seeds was not looked at; a phase that was looked at as sine and cosine
takes both. Levels of a map count by their distance from their mean: a common level is a Coulomb friction, which has a
row of its own. A finite seed whose amplitude is bounded below 1 is excluded, and the weakest of those is the limit.

Whether a limit is practically nothing is judged on the hold-out: by how much its simulation would be off if the rig
had the effect at its limit and the model had been fitted to the training recordings without it.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..identify.uncertainty import widened
from ..model.effects.base import parameters_of, unit_at
from ..model.effects.catalogue import KINDS
from ..model.parameters import ParameterTable
from .adequacy import LARGE
from .candidates import WRONG_VALUE
from .looks import Look, look
from .responses import choices, magnitude
from .result import NotSeen
from .search import Search
from .trials import State
from .words import assumed, limit_sentence

_NORMAL = 1.959964
_BEYOND = 1e6
"""A number that no effect of a laboratory's bridge reaches, in whatever unit: what has no limit below it has none."""
_CALLED_UP = 0.02
"""Root mean square response over the noise from which a finite seed counts as called up at all."""


def not_seen(search: Search, state: State, rivals: Collection[tuple[str, str]] = ()) -> tuple[NotSeen, ...]:
    """How large every effect that the model lacks may be; what may be more than noise first.

    Args:
        search: recordings.
        state: the final model, fitted.
        rivals: kinds and sites that the recordings cannot tell from what was named, and that are told as such.
    """
    search.progress("asking what could not have been seen")
    by_effect: dict[tuple, list[Look]] = {}
    for found in look(search, state):
        if found.candidate.name in rivals:
            continue
        by_effect.setdefault((*found.candidate.name, choices(found.candidate)), []).append(found)
    given = ParameterTable(search.given, search.setting.units)
    rows: list[NotSeen] = []
    for seeds in by_effect.values():
        if seeds[0].candidate.finite:
            rows.append(_of_finite(seeds, search.setting.units))
        else:
            rows += _of_null(seeds, search.setting.units, given)
    return tuple(sorted(rows, key=lambda row: (not row.notable, row.limit is not None, -(row.change or 0.0))))


def _of_null(seeds: Sequence[Look], inputs: Mapping[str, str], given: ParameterTable) -> list[NotSeen]:
    """Rows of an effect that has a tangent where it is absent, one for each of its numbers."""
    kind, site = seeds[0].candidate.name
    rows = []
    for key in dict.fromkeys(key for seed in seeds for key in seed.keys):
        able = [seed for seed in seeds if key in seed.keys]
        if kind == WRONG_VALUE:
            unit, one_sided = given.entry(given.positions(site)[0]).unit, False
        else:
            info = parameters_of(KINDS[kind])[key]
            unit, one_sided = unit_at(info.unit, site, inputs), info.low == info.null and not info.vector
        parts = [_bound(seed, key, one_sided) for seed in able]
        taken_up = any(bool(seed.taken_up[[k == key for k in seed.keys]].any()) for seed in able)
        limit = float(max(e for e, _, _ in parts) + _NORMAL * max(s for _, s, _ in parts))
        change = limit * max(c for _, _, c in parts)
        rows.append(_row(kind, site, key, limit if not taken_up and limit < _BEYOND else None, unit, change))
    called = {key for seed in seeds for key in seed.keys}
    for key in seeds[0].candidate.free:
        if kind != WRONG_VALUE and parameters_of(KINDS[kind])[key].vector and key not in called:
            rows.append(_row(kind, site, key, None, "", None, silent=True))
    if not rows:
        rows.append(_row(kind, site, seeds[0].candidate.free[0], None, "", None, silent=True))
    return rows


def _bound(seed: Look, key: str, one_sided: bool) -> tuple[float, float, float]:
    """Estimate, widened standard deviation and change per unit of one number, the worst of its entries if a list."""
    at = np.flatnonzero([k == key for k in seed.keys])
    estimate, covariance = seed.estimate, seed.covariance
    if seed.candidate.harmonic:
        # A sine and a cosine together make up any phase.
        parts = widened(np.sqrt(np.diag(covariance)[at]), np.abs(estimate[at]))
        most = max(0.0, *(float(np.linalg.eigvalsh(part)[-1]) for part in seed.change))
        return float(np.hypot.reduce(estimate[at])), float(np.hypot.reduce(parts)), float(np.sqrt(most))
    if len(at) > 1:
        # The mean of all levels of a map is left out, those of the other direction included.
        contrast = np.eye(len(estimate)) - 1.0 / len(estimate)
        estimate, covariance = contrast @ estimate, contrast @ covariance @ contrast.T
    value = np.maximum(estimate[at], 0.0) if one_sided else np.abs(estimate[at])
    variance = np.maximum(np.diag(covariance)[at], 1e-300)
    std = widened(np.sqrt(variance), value)
    worst = int(np.argmax(value + _NORMAL * std))
    # At its bound a number takes the effect's others along as far as the recordings ask for that.
    along = covariance[:, at[worst]] / variance[worst]
    # Of an effect that changes nothing, rounding may leave less than nothing.
    change = np.sqrt(max(0.0, *(float(along @ products @ along) for products in seed.change)))
    return float(value[worst]), float(std[worst]), float(change)


def _of_finite(seeds: Sequence[Look], inputs: Mapping[str, str]) -> NotSeen:
    """The row of an effect that is singular where it is absent."""
    candidates = [seed.candidate for seed in seeds]
    kind, site = candidates[0].name
    key = magnitude(candidates)
    unit = unit_at(parameters_of(KINDS[kind])[key].unit, site, inputs)
    excluded: list[tuple[float, float]] = []
    # From the strongest on, as long as each would have been seen.
    for seed in sorted(seeds, key=lambda s: -s.response.sum()):
        if seed.response.sum() < _CALLED_UP:
            break
        std = widened(np.sqrt(np.diag(seed.covariance)), seed.estimate)[0]
        bound = max(float(seed.estimate[0]), 0.0) + _NORMAL * float(std)
        if not bound < 1.0:
            break
        excluded.append((bound * float(np.sqrt(seed.change.max())), float(seed.candidate.values[key])))
    change, limit = excluded[-1] if excluded else (None, None)
    return _row(kind, site, key, limit, unit, change, finite=True, others=assumed(candidates[0], key))


def _row(
    kind: str,
    site: str,
    key: str,
    limit: float | None,
    unit: str,
    change: float | None,
    *,
    finite: bool = False,
    others: str = "",
    silent: bool = False,
) -> NotSeen:
    change = None if limit is None else change
    said = limit_sentence(key, limit, unit, change, finite=finite, silent=silent)
    if others:
        said += f" {others}"
    return NotSeen(kind, site, key, limit, unit, change, limit is None or (change or 0.0) > LARGE, said)
