"""The next experiment: the input that separates best what the recordings cannot tell apart.

Every input of a library (`inputs`) is simulated by every rival within the limits of the recordings (`limits`), judged
by the chance of a wrong decision that it leaves (`discrimination`), and the best ones are tried with other sizes and
periods.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...identification.estimation import Problem
from ...model.effects.catalogue import CATALOGUE
from ...model.names import explanation_name
from ..result import NextExperiment
from .discrimination import Contender, Separation, as_recording, guess, separations, start_length
from .inputs import Play, library, variants
from .limits import reach_of

_MOST_PLAYS = 24
_BEST = 2
"""Inputs of the library whose variants are tried, too."""
_ENOUGH = 1e-6
"""Chance of a wrong decision below which a smaller one is worth no further effort of the rig."""
_LEAST = 1e-3
"""No chance of a wrong decision is called smaller: no model is a rig."""
_HARDLY = 0.7
"""Chance of a wrong decision, over that without the input, from which the owner is told that it hardly decides."""


def next_experiment(
    contenders: Sequence[Contender], problem: Problem, progress: Callable[[str], None]
) -> NextExperiment | None:
    """The input that separates contenders best; None where no input is driven or none keeps within the limits.

    Args:
        contenders: at least two.
        problem: the recordings, which tell what is safe.
        progress: told what goes on.
    """
    setting = problem.setting
    reach = reach_of(setting, [c.plant for c in contenders])
    plays = library(reach, {c.axis for c in contenders})
    if not plays:
        return None
    progress(f"designing an experiment that tells {len(contenders)} explanations apart")
    found = separations(_thinned(plays), contenders, problem, reach)
    if not found:
        return None
    if found[0].log_wrong > np.log(_ENOUGH):
        more = [v for best in found[:_BEST] for v in variants(best.play, reach)]
        found += separations(more, contenders, problem, reach)
    chosen = _gentlest(found)
    today = guess([c.probability for c in contenders])
    wrong = float(np.clip(np.exp(chosen.log_wrong), _LEAST, today))
    recording = as_recording(chosen.play, reach, setting)
    columns = {name: getattr(recording, name) for name in reach.drives}
    names = tuple(explanation_name(c.kind, c.site) for c in contenders)
    start = {axis: value for axis, value in chosen.play.start.items() if axis in setting.axes}
    if "l" in setting.axes or "psi" in setting.axes:
        start["l"] = start_length(chosen.play, setting)
    return NextExperiment(
        _purpose(chosen.play, names, start, wrong > _HARDLY * today, _separated_by(contenders)),
        names,
        {"t": recording.times, **columns},
        wrong,
        start,
    )


def _gentlest(found: Sequence[Separation]) -> Separation:
    """The input that leaves the least chance of a wrong decision; of those that leave as good as none, the gentlest."""
    enough = max(min(s.log_wrong for s in found), float(np.log(_ENOUGH)))
    able = [s for s in found if s.log_wrong <= enough]
    return min(able, key=lambda s: (len(s.play.waves), max(w.size for w in s.play.waves.values()), s.log_wrong))


def _thinned(plays: Sequence[Play]) -> list[Play]:
    """At most so many plays, evenly from the list."""
    take = np.unique(np.linspace(0, len(plays) - 1, min(len(plays), _MOST_PLAYS)).round().astype(int))
    return [plays[i] for i in take]


def _separated_by(contenders: Sequence[Contender]) -> list[str]:
    """What the catalogue knows to separate those of the contenders that some recordings cannot tell apart."""
    names = {(c.kind, c.site) for c in contenders}
    alike = [(kind, other) for kind, _ in sorted(names) if kind in CATALOGUE for other in CATALOGUE[kind].alike]
    return [o.separated_by for kind, o in alike if {(kind, o.own_site), (o.kind, o.site)} <= names]


def _purpose(
    play: Play, names: Sequence[str], start: Mapping[str, float], hardly: bool, separated_by: Sequence[str]
) -> str:
    """What to do and why, for whoever plays it."""
    parts = []
    if "x" in start:
        parts.append(f"the cart at x = {start['x']:.3g} m")
    if "l" in start:
        parts.append(f"{start['l']:.3g} m of rope")
    if "psi" in start:
        parts.append("the load hanging still")
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    words = play.words
    text = f"{words[0].upper()}{words[1:]}, from rest with {', '.join(parts)}. This separates {listed}."
    if hardly:
        text += " It is unlikely to be decisive, but no other input tried within the recordings' limits does better."
        text += "".join(f" {words} would tell more." for words in separated_by)
    return text
