"""What a missing force is like, where nothing in the catalogue explains it: in the words of its symmetries.

The smoothed force of every recording is laid beside what it might depend on. What hangs together with it in some
recordings must foresee it in the others; nothing is said of what does not.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .repeats import hats
from .result import Likeness

INPUT_OF = {"x": "u_x", "psi": "u_x", "l": "u_l"}
"""The drive that moves each axis; a swing is driven by the cart."""
EITHER_WAY = ", direction"
"""Marks a variable that may count differently in either direction of motion."""
_WORDS = {
    "x": "cart's place",
    "psi": "swing's angle",
    "l": "rope length",
    "v_x": "cart's velocity",
    "v_psi": "swing's velocity",
    "v_l": "hoist's velocity",
    "u_x": "cart drive's input",
    "u_l": "hoist drive's input",
    "t": "time since the recording's start",
}
_PLACES, _VALUES = 24, 10
_RIDGE = 0.02
"""Relative to the samples: keeps what was hardly visited near nothing."""
_SINCE = (0.0, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, *(float(x) for x in np.linspace(0.02, 1.0, 50)))
"""Distances since the last reversal at which memory is looked for, over the span of the axis."""
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
"""Further share that the distance since a reversal must foresee."""


@dataclasses.dataclass(frozen=True)
class Track:
    """One recording with the force that its model lacks on one axis."""

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64]
    u: NDArray[np.float64]
    others: Mapping[str, NDArray[np.float64]]
    """What else it may hang on: the other axes' `x`, `v_x` and so on, and their inputs."""
    force: NDArray[np.float64]
    weight: NDArray[np.float64]
    """How well the force is known, 0 to 1."""


def describe(tracks: Sequence[Track], axis: str) -> Likeness:
    """Describes a force along recordings; of a single one, its quarters take the place of recordings.

    Args:
        tracks: the recordings, all with the same `others`.
        axis: `x`, `psi` or `l`.
    """
    if len(tracks) == 1:
        tracks = _quarters(tracks[0])
    low, high = _span(tracks, lambda t: t.q)
    top = max(float(np.quantile(np.abs(np.concatenate([t.v for t in tracks])), 0.98)), 1e-9)
    place = _hats(tracks, lambda t: t.q, low, high, _PLACES)
    turned = _turned(place, tracks)
    velocity = _hats(tracks, lambda t: t.v, -top, top, _VALUES)
    inputs = _hats(tracks, lambda t: t.u, *_span(tracks, lambda t: t.u), _VALUES)
    others = {name: _either_way(tracks, name) for name in tracks[0].others}
    clock = _hats(tracks, lambda t: t.times, 0.0, max(t.times[-1] for t in tracks), _PLACES)
    both = _beside(place, turned)
    every = _beside(both, velocity, inputs, clock, *(_beside(*pair) for pair in others.values()))
    since = [_since_reversal(t, high - low) for t in tracks]
    features = {
        axis: place,
        axis + EITHER_WAY: both,
        f"v_{axis}": velocity,
        INPUT_OF[axis]: inputs,
        "t": clock,
        **{name: _beside(*pair) for name, pair in others.items()},
    }
    by = {name: _share(tracks, tables) for name, tables in features.items()}
    best = most_telling(by)
    foreseen = max(by[best], _share(tracks, every))
    seen = _beside(both, velocity, features[best])  # what memory goes beyond
    likeness = Likeness(
        foreseen,
        by,
        _odd(tracks, place, turned, velocity, others, foreseen),
        _energy(tracks),
        _period(tracks, low, high, by[axis + EITHER_WAY]),
        _share(tracks, _beside(seen, since)) - _share(tracks, seen),
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
            words.append("turns round with the direction of motion, as friction does")
        elif found.odd < 1 - _CLEAR:
            words.append("is the same in both directions of motion, as a spring's or a slope's is")
        else:
            words.append("is different in the two directions of motion, but does not just turn round")
    if abs(found.energy) > _CLEAR and found.foreseen > _TOLD:
        words.append("takes energy out" if found.energy < 0 else "puts energy in")
    if found.period is not None:
        size = f"{np.degrees(found.period):.3g} degrees" if rotary else f"{1e3 * found.period:.3g} mm"
        words.append(f"repeats every {size}")
    if found.memory > _MEMORY:
        words.append("remembers: at the same place and velocity it depends on how far back the last reversal is")
    best = most_telling(found.by)
    if found.by[best] > _TOLD:
        name = best.removesuffix(EITHER_WAY)
        told = _WORDS[name] + (" and the direction of motion" if name != best else "")
        words.append(f"hangs on the {told} most ({100 * found.by[best]:.0f} % of it is foreseen by that alone)")
    if not words:
        return ""
    listed = words[0] if len(words) == 1 else f"{', '.join(words[:-1])}, and {words[-1]}"
    return f"The force that the model as given lacks {listed}."


def _quarters(track: Track) -> list[Track]:
    return [
        Track(
            track.times[rows],
            track.q[rows],
            track.v[rows],
            track.u[rows],
            {name: values[rows] for name, values in track.others.items()},
            track.force[rows],
            track.weight[rows],
        )
        for rows in np.array_split(np.arange(len(track.times)), 4)
    ]


def _span(tracks: Sequence[Track], pick: Callable[[Track], NDArray[np.float64]]) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(np.concatenate([pick(t) for t in tracks]), [0.002, 0.998]))
    return low, high


def _hats(
    tracks: Sequence[Track], pick: Callable[[Track], NDArray[np.float64]], low: float, high: float, count: int
) -> list[NDArray[np.float64]]:
    """Hat functions of a variable; none where it does not change."""
    if not high > low:
        return [np.zeros((len(t.times), 0)) for t in tracks]
    return [hats(pick(t), np.linspace(low, high, count)) for t in tracks]


def _beside(*features: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    return [np.concatenate(parts, axis=1) for parts in zip(*features, strict=True)]


def _either_way(tracks: Sequence[Track], name: str) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Hat functions of another variable, alike in both directions of motion, and turning round with it."""

    def pick(track: Track) -> NDArray[np.float64]:
        return track.others[name]

    even = _hats(tracks, pick, *_span(tracks, pick), _VALUES)
    return even, _turned(even, tracks)


def _turned(even: list[NDArray[np.float64]], tracks: Sequence[Track]) -> list[NDArray[np.float64]]:
    return [part * np.sign(t.v)[:, None] for part, t in zip(even, tracks, strict=True)]


def _since_reversal(track: Track, span: float) -> NDArray[np.float64]:
    """Hat functions of the distance since the velocity last changed sign, each with the sign of the velocity."""
    sign = np.sign(track.v)
    turned = np.flatnonzero(np.diff(sign) != 0) + 1
    last = np.searchsorted(turned, np.arange(len(sign)), side="right")
    origin = track.q[np.concatenate([[0], turned])[last]]
    away = np.abs(track.q - origin) / max(span, 1e-12)
    places = np.arange(len(_SINCE), dtype=float)  # uneven knots, taken to even ones
    return hats(np.interp(away, np.array(_SINCE), places), places) * sign[:, None]


def _fit(tables: Sequence[NDArray[np.float64]], tracks: Sequence[Track]) -> NDArray[np.float64]:
    count = max(sum(t.weight.sum() for t in tracks), 1.0)
    matrix = sum((a.T @ (a * t.weight[:, None]) for a, t in zip(tables, tracks, strict=True)), np.zeros(()))
    right = sum((a.T @ (t.weight * t.force) for a, t in zip(tables, tracks, strict=True)), np.zeros(()))
    return np.linalg.solve(matrix + _RIDGE * count / _PLACES * np.eye(tables[0].shape[1]), right)


def _share(tracks: Sequence[Track], tables: list[NDArray[np.float64]]) -> float:
    """Share of the force that what was learned from the other recordings foresees."""
    if not tables[0].shape[1]:
        return 0.0
    total, left = 0.0, 0.0
    for i, (track, table) in enumerate(zip(tracks, tables, strict=True)):
        others = [j for j in range(len(tracks)) if j != i]
        learned = _fit([tables[j] for j in others], [tracks[j] for j in others])
        total += float(track.weight @ track.force**2)
        left += float(track.weight @ (track.force - table @ learned) ** 2)
    return float(np.clip(1.0 - left / total, 0.0, 1.0)) if total > 0 else 0.0


def _odd(
    tracks: Sequence[Track],
    place: list[NDArray[np.float64]],
    turned: list[NDArray[np.float64]],
    velocity: list[NDArray[np.float64]],
    others: Mapping[str, tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]],
    foreseen: float,
) -> float | None:
    """Share that turns round with the velocity, of what foresees most; None where that is not nearly everything."""
    # Velocity's hats are symmetrical about nothing, so their mirror image is the force at the opposite velocity.
    mirrored = [c[:, ::-1] for c in velocity]
    ways = [
        (
            _beside(place, [c + m for c, m in zip(velocity, mirrored, strict=True)]),
            _beside(turned, [c - m for c, m in zip(velocity, mirrored, strict=True)]),
        ),
        *others.values(),
    ]
    shares = [_share(tracks, _beside(*way)) for way in ways]
    best = int(np.argmax(shares))
    if shares[best] < max(_TOLD, _MOSTLY * foreseen):
        return None
    even, odd = ways[best]
    learned = _fit(_beside(even, odd), tracks)
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
