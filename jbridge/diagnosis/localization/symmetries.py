"""What a missing force is like, where nothing in the catalogue explains it: in the words of its symmetries.

The smoothed force of every recording is laid beside what it might depend on. What hangs together with it in some
recordings must foresee it in the others; nothing is said of what does not.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ...model.names import quantity_name
from ..result import Likeness
from .missing_force import (
    INPUT_OF,
    Features,
    Table,
    Track,
    beside,
    features,
    foreseen,
    foreseen_by_few,
    learn,
    quarters,
)

EITHER_WAY = ", direction"
"""Marks a variable that may count differently in either direction of motion."""
_TOLD = 0.25
"""Share of a force that must be foreseen before anything is said of it."""
_CLEAR = 0.8
"""Share from which a force counts as odd or even, or as one that only takes or gives energy."""
_ABOUT = 0.05
"""Shares that differ by less count as the same."""
_MOSTLY = 0.8
"""Share of all that is foreseen that a way of looking must foresee for its symmetry to be the force's."""
_REPEATS = 0.7
"""Share of what the place foresees that one wave must foresee for the force to count as periodic."""
_MEMORY = 0.15
"""Further share that the distance or the time since a reversal must foresee."""


def describe(tracks: Sequence[Track], axis: str) -> Likeness:
    """Describes a force along recordings; of a single one, its quarters take the place of recordings.

    Args:
        tracks: the recordings, all with the same `others`.
        axis: `x`, `psi` or `l`.
    """
    if len(tracks) == 1:
        tracks = quarters(tracks[0])
    on = features(tracks)
    tables = {
        axis: on.place,
        axis + EITHER_WAY: on.both,
        f"v_{axis}": on.velocity,
        INPUT_OF[axis]: on.inputs,
        "t": on.clock,
        **{name: beside(*pair) for name, pair in on.others.items()},
    }
    by = {name: _share(tracks, table) for name, table in tables.items()}
    best = most_telling(by)
    most = max(by[best], foreseen_by_few(tracks, on.each()))
    seen = beside(on.both, on.velocity, tables[best])  # what memory goes beyond
    likeness = Likeness(
        most,
        by,
        _odd(tracks, on, most),
        _energy(tracks),
        _period(tracks, *on.span, by[axis + EITHER_WAY]),
        max(_share(tracks, beside(seen, memory)) for memory in (on.since, on.lasting)) - _share(tracks, seen),
        "",
    )
    return dataclasses.replace(likeness, statement=_sentence(likeness, rotary=axis == "psi"))


def most_telling(by: Mapping[str, float]) -> str:
    """The variable that foresees most; of those that do about as well the plainest, which comes first."""
    most = max(by.values())
    return next(name for name, share in by.items() if share >= most - _ABOUT)


def _sentence(found: Likeness, rotary: bool) -> str:
    words = []
    if found.odd is not None:
        if found.odd > _CLEAR:
            words.append("reverses with the direction of motion, as friction does")
        elif found.odd < 1 - _CLEAR:
            words.append("is the same in both directions of motion, as a spring's or a slope's is")
        else:
            words.append("is different in the two directions of motion, but does not simply reverse")
    if abs(found.energy) > _CLEAR and found.foreseen > _TOLD:
        words.append("takes energy out" if found.energy < 0 else "puts energy in")
    if found.period is not None:
        size = f"{np.degrees(found.period):.3g} degrees" if rotary else f"{1e3 * found.period:.3g} mm"
        words.append(f"repeats every {size}")
    if found.memory > _MEMORY:
        words.append(
            "shows hysteresis: at the same place and velocity it depends on the time or distance since a reversal"
        )
    best = most_telling(found.by)
    if found.by[best] > _TOLD:
        name = best.removesuffix(EITHER_WAY)
        told = quantity_name(name) + (" and the direction of motion" if name != best else "")
        words.append(f"depends most on the {told}, which alone predicts {100 * found.by[best]:.0f} % of it")
    if not words:
        return ""
    listed = words[0] if len(words) == 1 else f"{', '.join(words[:-1])}, and {words[-1]}"
    return f"The force that the model as given lacks {listed}."


def _share(tracks: Sequence[Track], table: Table) -> float:
    return min(max(foreseen(tracks, table), 0.0), 1.0)


def _odd(tracks: Sequence[Track], on: Features, most: float) -> float | None:
    """Share that reverses with the velocity, of what foresees most; None where that is not nearly everything."""
    # Velocity's hats are symmetrical about nothing, so their mirror image is the force at the opposite velocity.
    mirrored = [c[:, ::-1] for c in on.velocity]
    ways = [
        (
            beside(on.place, [c + m for c, m in zip(on.velocity, mirrored, strict=True)]),
            beside(on.turned, [c - m for c, m in zip(on.velocity, mirrored, strict=True)]),
        ),
        *on.others.values(),
    ]
    shares = [_share(tracks, beside(*way)) for way in ways]
    best = int(np.argmax(shares))
    if shares[best] < max(_TOLD, _MOSTLY * most):
        return None
    even, odd = ways[best]
    learned = learn(tracks, beside(even, odd))
    n = even[0].shape[1]
    powers = [
        sum(float(t.weight @ (table @ part) ** 2) for t, table in zip(tracks, tables, strict=True))
        for tables, part in ((even, learned[:n]), (odd, learned[n:]))
    ]
    return powers[1] / max(sum(powers), 1e-300)


def _energy(tracks: Sequence[Track]) -> float:
    power = np.concatenate([t.weight * t.force * t.v for t in tracks])
    return float(power.sum() / max(float(np.abs(power).sum()), 1e-300))


def _period(tracks: Sequence[Track], low: float, high: float, by_place: float) -> float | None:
    """The length of a single wave along the axis that foresees most of what the place does."""
    if not high > low:
        return None
    best, period = 0.0, None
    for halves in range(4, 81):
        length = 2 * (high - low) / halves
        tables = []
        for t in tracks:
            phase = 2 * np.pi * t.q / length
            wave = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase)], axis=1)
            tables.append(np.concatenate([wave, wave * np.sign(t.v)[:, None]], axis=1))
        share = _share(tracks, tables)
        if share > best:
            best, period = share, length
    flat = [np.stack([np.ones_like(t.q), np.sign(t.v)], axis=1) for t in tracks]
    plain = _share(tracks, flat)
    # What a constant foresees is no wave.
    return period if best - plain > _REPEATS * max(by_place - plain, 0.0) and best - plain > _TOLD else None
